"""Draws from the posterior by importance resampling: for beliefs that are far from normal.

Proposals are from a multivariate t about the optimum with the fit's covariance; each is weighed by its posterior, with
flights linear about the optimum and outcomes exact, and as many as are wanted are drawn by these weights (Rubin 1988).
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.stats import multivariate_t

from truearc.errors import whole_file
from truearc.sim.infer.baseline_fit import limits_of
from truearc.sim.infer.held_out import log_posterior
from truearc.sim.infer.map_fit import MapFit
from truearc.sim.printed import Progress

PROPOSED = 4                          # proposals for each draw, and no fewer than LEAST
LEAST = 1000
FREEDOM = 5                           # of the t: tails heavier than the posterior's
FEWEST_EFFECTIVE = 0.1                # of the proposals: the weights of the others are next to nothing


@dataclass(frozen=True, eq=False)
class Posterior:
    """`draws` of the parameters in their own units. effective: independent draws that the weighed proposals amount to.
    """

    names: tuple[str, ...]
    draws: Float[np.ndarray, "count p"]
    effective: float
    proposed: int
    seed: int

    @property
    def count(self) -> int:
        return len(self.draws)

    @property
    def converged(self) -> bool:
        return self.effective > FEWEST_EFFECTIVE * self.proposed


def sample(fit: MapFit, count: int, seed: int, progress: Progress = lambda done, note: None) -> Posterior:
    """Return `count` draws; the same seed gives the same ones."""
    evidence, rng = fit.evidence, np.random.default_rng(seed)
    covariance = evidence.covariance
    proposal = multivariate_t(np.zeros(len(covariance)), covariance, FREEDOM, allow_singular=True, seed=rng)
    proposed = max(PROPOSED * count, LEAST)
    changes = np.atleast_2d(proposal.rvs(proposed)).reshape(proposed, -1)
    limits = np.array([limits_of(fit.fitted.layout, k) if column.kind != "group" else (-np.inf, np.inf)
                       for k, column in enumerate(evidence.columns)])
    inside = ((evidence.point + changes >= limits[:, 0]) & (evidence.point + changes <= limits[:, 1])).all(1)
    nats = np.full(proposed, -np.inf)
    for number, row in enumerate(np.flatnonzero(inside)):
        if number % 100 == 0:
            progress(number / proposed, f"{number} of {proposed} proposals weighed")
        nats[row] = log_posterior(evidence, changes[row], slice(None)) - proposal.logpdf(changes[row])
    weight = np.exp(nats - nats.max())
    weight /= weight.sum()
    progress(1.0, "drawn")
    chosen = changes[rng.choice(proposed, count, p=weight)]
    columns = [np.vectorize(one.value, otypes=[float])(evidence.point[one.column] + chosen[:, one.column])
               for one in fit.sought]
    return Posterior(fit.names, np.stack(columns, axis=1), float(1.0 / (weight**2).sum()), proposed, seed)


def save_draws(path: str | Path, posterior: Posterior) -> None:
    """npz: names [p], draws [count, p] in the parameters' own units, effective."""
    with whole_file(path) as new, new.open("wb") as file:
        np.savez_compressed(file, names=np.array(posterior.names), draws=posterior.draws,
                            effective=posterior.effective)


def say_posterior(posterior: Posterior) -> Iterable[str]:
    """A line a parameter, and whether the draws are to be believed."""
    low, middle, high = np.quantile(posterior.draws, [0.05, 0.5, 0.95], axis=0)
    for index, name in enumerate(posterior.names):
        yield f"{name:24s} median {middle[index]:.3g}, 90 % {low[index]:.3g} to {high[index]:.3g}"
    yield f"{posterior.effective:.0f} effective draws of {posterior.proposed} proposed"
    if not posterior.converged:
        yield "too few proposals are likely: do not rely on these draws; rely on the intervals of the fit"
