"""Fits of several rigs or sessions pooled: a hierarchical model of their numbers (Gelman et al. 2013, chapter 5).

The number k of member i is theta_ik ~ N(mu_k, tau_k^2), each on its own scale; what the member's shots say of its
numbers is normal, as its fit has it, with the fit's prior taken out again. mu has the prior of a single fit, tau a
half-normal one: members that are sessions of one rig are more alike than rigs are. mu and theta are integrated out;
tau is drawn from its posterior by Gibbs sampling on a grid that its prior holds equally likely.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.stats import halfnorm

from truearc.errors import InputError
from truearc.sim.infer.belief import launcher_of
from truearc.sim.infer.likelihood.belief_prior import MOVES, own_slope
from truearc.sim.infer.likelihood.noise import WEAKER
from truearc.sim.infer.map_fit import MapFit
from truearc.sim.infer.profile import BEYOND, deviations

GRID = 40                             # sizes of each tau, equally likely a priori
SWEEPS, BURN = 600, 100               # of Gibbs sampling
Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Said:
    """What shots of several members say of numbers [k] on their scales, as normal densities without a prior.

    information [m, k, k] and onto [m, k], which is information times the most likely numbers; a member that has no such
    number has zeros there. centre, sd [k]: the prior of what they have in common. spread [k]: standard deviation of
    the half-normal prior of tau.
    """

    information: Float[Array, "m k k"]
    onto: Float[Array, "m k"]
    centre: Float[Array, " k"]
    sd: Float[Array, " k"]
    spread: Float[Array, " k"]


@dataclass(frozen=True, eq=False)
class Pooling:
    """Draws of the posterior.

    tau [d, k]; mean [d, k] and covariance [d, k, k] of mu by each draw of tau; own [m, k] and own_sd [m, k]: each
    member's numbers given all members.
    """

    tau: Float[Array, "d k"]
    mean: Float[Array, "d k"]
    covariance: Float[Array, "d k k"]
    own: Float[Array, "m k"]
    own_sd: Float[Array, "m k"]

    @property
    def common(self) -> tuple[Float[Array, " k"], Float[Array, "k k"]]:
        """(mean, covariance) of what the members have in common."""
        return self.mean.mean(0), self.covariance.mean(0) + np.cov(self.mean.T).reshape(self.covariance.shape[1:])

    @property
    def next_one(self) -> Float[Array, "k k"]:
        """The covariance of the numbers of a member that was not there."""
        return self.common[1] + np.diag((self.tau**2).mean(0))


def pool_normal(said: Said, seed: int = 0) -> Pooling:
    """Pool what the members' shots say; the same seed gives the same draws."""
    rng = np.random.default_rng(seed)
    grid = halfnorm.ppf((np.arange(GRID) + 0.5) / GRID) * said.spread[:, None]
    tau, kept = np.median(grid, axis=1), []
    for sweep in range(BURN + SWEEPS):
        for k, sizes in enumerate(grid):
            tried = np.tile(tau, (GRID, 1))
            tried[:, k] = sizes
            value = _marginal(said, tried)[0]
            share = np.exp(value - value.max())
            tau[k] = sizes[rng.choice(GRID, p=share / share.sum())]
        if sweep >= BURN:
            kept.append(tau.copy())
    draws = np.array(kept)
    _, mean, covariance = _marginal(said, draws)
    return Pooling(draws, mean, covariance, *_own(said, draws, mean, covariance))


def _marginal(said: Said, tau: Float[Array, "d k"]) -> tuple[Float[Array, " d"], Float[Array, "d k"],
                                                              Float[Array, "d k k"]]:
    """(log evidence up to a constant, mean and covariance of mu) by each of the `tau`."""
    one = np.eye(len(said.centre))
    inner = one + said.information * (tau**2)[:, None, None, :]
    solved = np.linalg.solve(inner, np.concatenate([said.information, said.onto[..., None]], axis=2)[None])
    precision = solved[..., :-1].sum(1) + np.diag(said.sd**-2.0)
    pull = solved[..., -1].sum(1) + said.centre / said.sd**2
    within = np.einsum("mk,dk,dmk->d", said.onto, tau**2, solved[..., -1])
    mean = np.linalg.solve(precision, pull[..., None])[..., 0]
    value = 0.5 * (within + (pull * mean).sum(1) - np.linalg.slogdet(precision)[1]
                   - np.linalg.slogdet(inner)[1].sum(1))
    return value, mean, np.linalg.inv(precision)


def _own(said: Said, tau: Float[Array, "d k"], mean: Float[Array, "d k"],
         covariance: Float[Array, "d k k"]) -> tuple[Float[Array, "m k"], Float[Array, "m k"]]:
    """Mean and standard deviation of each member's own numbers."""
    means, deviations = [], []
    for information, onto in zip(said.information, said.onto, strict=True):
        narrow = np.linalg.inv(np.eye(len(onto)) + tau[:, :, None]**2 * information)     # shrinks toward mu
        here = np.einsum("dij,dj->di", narrow, mean + tau**2 * onto)
        there = narrow * (tau**2)[:, None, :] + narrow @ covariance @ np.swapaxes(narrow, 1, 2)
        means.append(here.mean(0))
        deviations.append(np.sqrt(np.diagonal(there, axis1=1, axis2=2).mean(0) + here.var(0)))
    return np.array(means), np.array(deviations)


def said_by(fits: Sequence[MapFit]) -> tuple[tuple[str, ...], Said]:
    """(names, what each fit's shots say); InputError where the fits are of different terms or have no number."""
    for fit in fits[1:]:
        if set(fit.terms) != set(fits[0].terms):
            raise InputError(f"{fit.dataset.name} is fitted with {', '.join(fit.terms)}, {fits[0].dataset.name} with "
                             f"{', '.join(fits[0].terms)}; pool fits of the same terms")
    names = tuple(dict.fromkeys(name for fit in fits for name in fit.belief.names))
    if not names:
        raise InputError(f"{', '.join(fit.dataset.name for fit in fits)}: these terms have no number that is fitted; "
                         "nothing to pool")
    k = len(names)
    information, onto = np.zeros((len(fits), k, k)), np.zeros((len(fits), k))
    centre, sd = np.zeros(k), np.ones(k)
    for number, fit in enumerate(fits):
        belief = fit.belief
        place = [names.index(name) for name in belief.names]
        centre[place], sd[place] = _prior(fit)
        whole = np.linalg.inv(belief.covariance)
        alone = _positive(whole - np.diag(sd[place]**-2.0))
        likeliest = np.linalg.pinv(alone, hermitian=True) @ (whole @ belief.values() - centre[place] / sd[place]**2)
        wider = _wider(fit)
        alone /= np.outer(wider, wider)
        information[number][np.ix_(place, place)], onto[number, place] = alone, alone @ likeliest
    return names, Said(information, onto, centre, sd, sd / WEAKER * (MOVES if one_rig(fits) else 1.0))


def one_rig(fits: Sequence[MapFit]) -> bool:
    """Whether ball and wheels of all are the same."""
    return all(launcher_of(fit.dataset.rig) == launcher_of(fits[0].dataset.rig) for fit in fits)


def _wider(fit: MapFit) -> Float[Array, " p"]:
    """How many times as far off as the likelihood says the belief's numbers are, by how tracked shots contradict each
    other: as the fit's own intervals have it."""
    known = {one.name: one.column for one in fit.sought}
    by_model, by_shots = np.array([deviations(fit, known[name]) for name in fit.belief.names]).T
    return np.where(fit.fitted.intake.filmed & (by_shots > BEYOND * by_model), by_shots / by_model, 1.0)


def _prior(fit: MapFit) -> tuple[Float[Array, " p"], Float[Array, " p"]]:
    """(centre, standard deviation) of the belief's numbers on their scales, as the fit had them."""
    known = {one.name: one for one in fit.sought}
    centre, sd = [], []
    for name, number in zip(fit.belief.names, fit.belief.values(), strict=True):
        one = known[name]
        at = float(fit.evidence.point[one.column])
        slope = own_slope(fit.evidence.columns[one.column].name, at, fit.catalogue)
        centre.append(number + (one.centre - at) / slope)
        sd.append(one.sd / abs(slope))
    return np.array(centre), np.array(sd)


def _positive(matrix: Float[Array, "p p"]) -> Float[Array, "p p"]:
    """Without what rounding made negative."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    kept: Array = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return kept
