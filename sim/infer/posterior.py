"""Samples of the posterior by NumPyro's NUTS: for beliefs that are far from normal.

Forward-mode derivatives, flights of a fixed number of steps, unit normal priors (the parameters are in units of
theirs), started in the optimum with its covariance as mass matrix.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from numpyro.diagnostics import effective_sample_size, split_gelman_rubin
from numpyro.infer import MCMC, NUTS

from truearc.sim.infer.likelihood.shot_likelihood import objective
from truearc.sim.infer.map_fit import MapFit
from truearc.sim.progress import Progress

CHAINS = 2
WARMUP = 150
SPLIT_R_HAT = 1.05                    # chains that differ by more have not mixed
FEWEST_EFFECTIVE = 50.0


@dataclass(frozen=True, eq=False)
class Posterior:
    """`draws` of the parameters in their own units; r_hat and effective samples of each; divergent steps."""

    names: tuple[str, ...]
    draws: Float[np.ndarray, "count p"]
    r_hat: Float[np.ndarray, " p"]
    effective: Float[np.ndarray, " p"]
    divergent: int
    seed: int

    @property
    def count(self) -> int:
        return len(self.draws)

    @property
    def converged(self) -> bool:
        enough = min(FEWEST_EFFECTIVE, 0.1 * self.count)
        return bool((self.r_hat < SPLIT_R_HAT).all() and (self.effective > enough).all())


def sample(fit: MapFit, count: int, seed: int,
           progress: Progress = lambda done, note: None) -> Posterior:
    """At least `count` draws are made in CHAINS chains, and `count` kept; the same seed gives the same draws."""
    problem = fit.problem
    spread = np.linalg.cholesky(fit.covariance)

    def potential(z: Float[jax.Array, " p"]) -> Float[jax.Array, ""]:
        u = fit.optimum.u + spread @ z
        value = objective(problem.model, problem.evidence, problem.points, problem.weight, u)
        return jnp.where(jnp.isfinite(value), value, 1e10)

    kernel = NUTS(potential_fn=potential, dense_mass=True, forward_mode_differentiation=True, target_accept_prob=0.85,
                  max_tree_depth=6)
    each = max(-(-count // CHAINS), 4)
    mcmc = MCMC(kernel, num_warmup=WARMUP, num_samples=each, progress_bar=False)     # compiled once for all chains
    drawn, divergent = [], 0
    for chain in range(CHAINS):
        progress(chain / CHAINS, f"chain {chain + 1} of {CHAINS}")
        key, start_key = jax.random.split(jax.random.PRNGKey(seed + 1000003 * chain))
        start = 0.5 * jax.random.normal(start_key, (len(spread),))
        mcmc.run(key, init_params=start, extra_fields=("diverging",))
        drawn.append(np.asarray(mcmc.get_samples()))
        divergent += int(np.asarray(mcmc.get_extra_fields()["diverging"]).sum())
    progress(1.0, "drawn")
    return _posterior(fit, np.stack(drawn), spread, divergent, count, seed)


def _posterior(fit: MapFit, chains: Float[np.ndarray, "chains draws p"], spread: Float[np.ndarray, "p p"],
               divergent: int, count: int, seed: int) -> Posterior:
    u = fit.optimum.u + chains @ spread.T
    r_hat, effective = np.asarray(split_gelman_rubin(u)), np.asarray(effective_sample_size(u))
    flat = u.swapaxes(0, 1).reshape(-1, u.shape[-1])[:count]
    columns = [np.asarray(one.value(column)) for one, column in zip(fit.model.sought, flat.T, strict=True)]
    return Posterior(fit.model.names, np.stack(columns, axis=1), r_hat, effective, divergent, seed)


def save_draws(path: str | Path, posterior: Posterior) -> None:
    """npz: names [p], draws [count, p] in the parameters' own units, r_hat [p], effective [p]."""
    with Path(path).open("wb") as file:
        np.savez_compressed(file, names=np.array(posterior.names), draws=posterior.draws, r_hat=posterior.r_hat,
                            effective=posterior.effective)


def say_posterior(posterior: Posterior) -> Iterable[str]:
    """A line a parameter, and whether the sampler is to be believed."""
    low, middle, high = np.quantile(posterior.draws, [0.05, 0.5, 0.95], axis=0)
    for index, name in enumerate(posterior.names):
        yield (f"{name:24s} median {middle[index]:.3g}, 90 % {low[index]:.3g} to {high[index]:.3g}; r-hat "
               f"{posterior.r_hat[index]:.3f}, effective samples {posterior.effective[index]:.0f}")
    yield f"divergent steps: {posterior.divergent} of {posterior.count}"
    if not posterior.converged:
        yield "the chains have not mixed: do not rely on these draws; ask for more"
