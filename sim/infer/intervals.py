"""Intervals for fitted numbers, by profile likelihood for one fit and by pooling for several.

Profile likelihood gives the range of one parameter while all others adjust (Raue et al. 2009).

A Hessian describes only the neighbourhood of the optimum; a profile continues until the fit has actually become worse,
and shows whether the data or only the prior stopped it. The profile is adjusted for the precision of the other
parameters (Cox and Reid 1987; Laplace's approximation of the marginal posterior): it is minus the log posterior plus
half the log determinant of the others' curvature. Without this adjustment, a scatter that is fitted together with
coefficients from the same shots is too small, and its interval is too short.

Flights are linearised about the optimum during the search; each end of an interval is then corrected with new flights.

If a simulation lacks an effect that tracks show, the tracks disagree with it by far more than their noise, and no
likelihood gives a parameter's error. The spread of the shots' scores still does (sandwich estimate: Huber 1967, White
1982).

Pooling of several rigs or sessions uses a hierarchical model of their numbers (Gelman et al. 2013, chapter 5).

Number k of member i is theta_ik ~ N(mu_k, tau_k^2), each on its own scale. The likelihood of a member's numbers is
normal: the result of its fit with the fit's prior removed. mu has the prior of a single fit, and tau has a half-normal
prior, which is narrower for sessions of one rig than for several rigs. mu and theta are integrated out; tau is drawn
from its posterior by Gibbs sampling on a grid whose points its prior makes equally likely.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import brentq, minimize_scalar
from scipy.stats import halfnorm
from scipy.stats import t as student

from truearc.errors import InputError
from truearc.sim.infer.belief import launcher_of
from truearc.sim.infer.fit import climb, objective
from truearc.sim.infer.launcher import MapFit, Sought
from truearc.sim.infer.likelihood.layout import MOVES, is_tracker, own_slope
from truearc.sim.infer.likelihood.noise import WEAKER
from truearc.sim.infer.likelihood.score_table import ScoreTable, fit_linear, log_posterior
from truearc.sim.physics.catalogue import Catalogue
from truearc.sim.statistics import Z90

WIDEST = 8.0                          # prior standard deviations from the optimum; further is open
GROWTH = 1.5                          # of a step that has not yet come to the end
NEARBY = 1.5                          # standard errors, in which the adjusted optimum is looked for
TOLERANCE = 0.02                      # of Z90, in which an end is accepted
PUT_RIGHT = 4                         # flights at most
# Derived: of the prior's deviation, below which data know more than the prior, 1 / sqrt(2)
KNOWN = 0.7
# Chosen: thirty shots scatter by 1 +- 0.13 of it. Measured: lift from three thirds of the table-tennis launcher agrees
# with the wider deviation, and not without it (git show 6276bab4)
BEYOND = 1.5                          # times the deviation by the likelihood, from which that by the shots counts
MOST_PUT_RIGHT = 2.0                  # factor by which flying again may move an end


def estimate_by_shots(evidence: ScoreTable, places: Sequence[int]) -> tuple[Float[np.ndarray, " k"],
                                                                            Float[np.ndarray, "k k"]]:
    """(values, sandwich covariance by clusters of shots) of some columns, one step from the top, with all shared ones
    free."""
    first, label = evidence.first_shared, evidence.together
    kept = [k for k in places if k < first] + list(range(first, len(evidence.columns)))
    extra, at = len(kept) - len(evidence.precision), [kept.index(k) for k in places]
    usual = np.array([evidence.columns[k].usual for k in kept])
    prior = np.diag(usual**-2.0)
    prior[extra:, extra:] = evidence.precision
    inverse = np.linalg.inv(evidence.information[np.ix_(kept, kept)] + prior)
    score = np.zeros((int(label.max()) + 1, len(kept)))
    np.add.at(score, label, evidence.score[:, kept])
    many = len(np.unique(label))
    middle = score.T @ score * many / (many - 1)
    middle[at, at] += usual[at]**-2.0
    step = inverse @ (score.sum(0) + np.concatenate([np.zeros(extra), evidence.pull]))
    start = np.concatenate([np.zeros(extra), evidence.point[first:]])
    return (start + step)[at], (inverse @ middle @ inverse)[np.ix_(at, at)]


# Chosen: as FALSE_ALARM. Measured: of 120 simulated datasets of 60 tracks without errors 1 had one said
WRONG = 0.05                          # probability that an error is seen where there is none
MOST_TOGETHER = 3                     # errors of which one is there; chosen: a printed sentence


@dataclass(frozen=True)
class NumberChange:
    """A column, the probability that it changed, and the change [its unit] if it did."""

    name: str
    unit: str
    probability: float
    change: float
    sd: float


def tracker_errors(evidence: ScoreTable, among: Catalogue) -> tuple[tuple[NumberChange, ...], ...]:
    """Return the errors of the tracker that are known, as changes from 0: one alone, or two or three of which one at
    least is there, each as likely.

    Of two errors that do much the same to tracks, such as of lengths and of the clock, neither may be known although
    one combination of them is. Each member of a set is then far from 0 where the others are 0: their t statistics
    exceed what any subset of a tracker without errors exceeds with probability WRONG (Bonferroni). Sets hold no smaller
    one. Intervals use Fisher information or the sandwich variance, whichever is wider.
    """
    places = [k for k, column in enumerate(evidence.columns[evidence.shared], evidence.first_shared)
              if is_tracker(column, among)]
    spare = len(np.unique(evidence.together)) - len(places)
    subsets = [list(one) for size in range(1, MOST_TOGETHER + 1) for one in combinations(range(len(places)), size)]
    if not places or spare < 1:
        return ()
    value, by_shots = estimate_by_shots(evidence, places)
    limit, found = float(student.isf(0.5 * WRONG / len(subsets), spare)), list[list[int]]()
    errors = []
    for subset in subsets:
        own = np.array(places)[subset]
        by_model, sandwich = (np.linalg.inv(covariance) for covariance in (
            evidence.covariance[np.ix_(own, own)], by_shots[np.ix_(subset, subset)]))
        size = by_model @ value[subset] / np.diag(by_model)          # where the others of the subset are 0
        sd = np.maximum(np.diag(by_model)**-0.5, np.diag(sandwich)**-0.5)
        if not any(set(one) <= set(subset) for one in found) and (np.abs(size) > limit * sd).all():
            found.append(subset)
            errors.append(tuple(NumberChange(evidence.columns[k].name, evidence.columns[k].unit, 1.0 / len(subset),
                                             float(size[n]), float(sd[n])) for n, k in enumerate(own)))
    return tuple(errors)


@dataclass(frozen=True)
class ProfileInterval:
    """90 % interval of one parameter in its own unit.

    `low_by_data`, `high_by_data`: most of what stopped the walk on that side is data, not prior or the end of the
    parameter's range. closed False: an end was never reached, and is where the walk stopped.
    """

    name: str
    value: float
    low90: float
    high90: float
    low_by_data: bool
    high_by_data: bool
    closed: bool


class _Held(NamedTuple):
    """The others at their best with the parameter held: adjusted cost in nats, their change, and the prior's share."""

    cost: float
    change: Float[np.ndarray, " P"]
    by_prior: float


class Profile:
    """The profile of one parameter, as a function of the distance of its column from the optimum."""

    def __init__(self, fit: MapFit, one: Sought) -> None:
        self.fit, self.one, self.at = fit, one, cache(self._at)
        self.free: Bool[np.ndarray, " P"] = np.arange(len(fit.scores.columns)) != one.column
        self.train = np.full(len(fit.scores.rows), True)
        covariance = fit.scores.covariance
        self.se = float(np.sqrt(covariance[one.column, one.column]))
        self.ridge = covariance[:, one.column] / covariance[one.column, one.column]
        point = float(fit.scores.point[one.column])
        low, high = fit.fitted.model.limits(one.column)
        self.limits = low - point, high - point
        found = minimize_scalar(lambda step: self.at(step).cost, method="bounded", options={"xatol": 0.02 * self.se},
                                bounds=(max(-NEARBY * self.se, self.limits[0]), min(NEARBY * self.se, self.limits[1])))
        best = min((0.0, float(found.x)), key=lambda step: self.at(step).cost)
        self.middle, self.ground = best, self.at(best)

    def _at(self, step: float) -> _Held:
        """Return the profile with flights linear about the optimum."""
        evidence = self.fit.scores
        change = fit_linear(evidence, self.train, self.ridge * step, self.free)
        info = evidence.deal.total(evidence.slopes_at(np.tile(change, (len(self.train), 1)))[1])
        return self._held(-log_posterior(evidence, change, self.train), info, change)

    def flown(self, change: Float[np.ndarray, " P"]) -> _Held:
        """Return the profile with new flights, the other parameters reoptimised."""
        model, point = self.fit.fitted.model, self.fit.fitted.point
        scatters = [column for column in model.layout.scatters if column >= 0]
        parts = int(np.ceil(np.abs(change[scatters]).max(initial=1.0)))
        for _ in range(parts):        # a scatter's logarithm moves by 1 at most at a time
            point = model.moved(point, change / parts)
        scores = climb(model, point, held=~self.free).scores
        lost = objective(self.fit.scores, model.layout) - objective(scores, model.layout)
        return self._held(lost, scores.information, scores.point - self.fit.scores.point)

    def _held(self, lost: float, info: Float[np.ndarray, "P P"], change: Float[np.ndarray, " P"]) -> _Held:
        evidence = self.fit.scores
        others = (info + evidence.precision)[self.free][:, self.free]
        by_prior = float(0.5 * change @ evidence.precision @ change - evidence.pull @ change)
        return _Held(lost + 0.5 * float(np.linalg.slogdet(others)[1]), change, by_prior)

    def root(self, held: _Held) -> float:
        return float(np.sqrt(2.0 * max(held.cost - self.ground.cost, 0.0)))

    def end(self, sign: float) -> tuple[float, bool, bool]:
        """Return (step of the end on one side, closed by data, closed)."""
        limit = self.limits[sign > 0.0]
        most = sign * min(abs(limit), WIDEST * self.one.sd)
        inside, step = self.middle, self.middle + sign * Z90 * self.se
        while abs(step) < abs(most) and self.root(self.at(step)) < Z90:
            inside, step = step, self.middle + GROWTH * (step - self.middle)
        if abs(step) >= abs(most):
            step = most
            if self.root(self.at(step)) < Z90:
                return step, False, abs(limit) < WIDEST * self.one.sd
        linear = float(brentq(lambda place: self.root(self.at(place)) - Z90, inside, step, xtol=1e-3 * self.se))
        exact, held = linear, self.at(linear)
        for _ in range(PUT_RIGHT):
            root = self.root(self.flown(self.at(exact).change))
            if abs(root - Z90) < TOLERANCE * Z90:
                break
            right = float(np.clip(Z90 / max(root, 1e-9), 1.0 / MOST_PUT_RIGHT, MOST_PUT_RIGHT))
            exact = sign * min(sign * (self.middle + (exact - self.middle) * right), sign * limit)
        lost = held.cost - self.ground.cost
        return exact, lost - (held.by_prior - self.ground.by_prior) > 0.5 * lost, True


def profile_interval(fit: MapFit, name: str) -> ProfileInterval:
    """Return the profile interval of one fitted parameter.

    With tracks, which make it normal, the interval uses Fisher information, or the sandwich variance if shots
    contradict each other.
    """
    one = fit.sought[fit.names.index(name)]
    point = float(fit.scores.point[one.column])
    if fit.fitted.model.data.filmed:
        by_model, by_shots = deviations(fit, one.column)
        sd = by_shots if by_shots > BEYOND * by_model else by_model
        least, most = fit.fitted.model.limits(one.column)
        low, high = max(point - Z90 * sd, least), min(point + Z90 * sd, most)
        by_data = bool(by_model < KNOWN * one.sd)
        return ProfileInterval(name, one.value(point), one.value(low), one.value(high), by_data and low > least,
                               by_data and high < most, True)
    walk = Profile(fit, one)
    low, low_data, low_closed = walk.end(-1.0)
    high, high_data, high_closed = walk.end(1.0)
    return ProfileInterval(name, one.value(point), one.value(point + low), one.value(point + high), low_data, high_data,
                           low_closed and high_closed)


def deviations(fit: MapFit, column: int) -> tuple[float, float]:
    """Return standard deviations of a column: from the information, and from the scores' spread over shots, or over
    balls."""
    evidence = fit.scores
    covariance = evidence.covariance
    together = fit.scores.together
    score = np.zeros((together.max() + 1, len(evidence.columns)))
    np.add.at(score, together, evidence.score)
    return float(np.sqrt(covariance[column, column])), float(np.linalg.norm(score @ covariance[column]))


GRID = 40                             # sizes of each tau, equally likely a priori
SWEEPS, BURN = 600, 100               # of Gibbs sampling
Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Said:
    """What the shots of several members say about numbers [k] on their scales, as normal densities without a prior.

    information [m, k, k] and onto [m, k], which is information times the most likely numbers; zeros for a member
    without such a number. centre, sd [k]: the prior of the common values. spread [k]: standard deviation of the
    half-normal prior of tau.
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
        """Return (mean, covariance) of the common values."""
        return self.mean.mean(0), self.covariance.mean(0) + np.cov(self.mean.T).reshape(self.covariance.shape[1:])

    @property
    def next_one(self) -> Float[Array, "k k"]:
        """Return the covariance of the numbers of a new member."""
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
    inner = np.eye(len(said.centre)) + said.information * (tau**2)[:, None, None, :]
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
    """Return (names, what each fit's shots say); InputError if the fits are of different terms or have no number."""
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
    """Return whether all have the same ball and wheels."""
    return all(launcher_of(fit.dataset.rig) == launcher_of(fits[0].dataset.rig) for fit in fits)


def _wider(fit: MapFit) -> Float[Array, " p"]:
    """How many times as far off as the likelihood says the belief's numbers are, by how tracked shots contradict each
    other: as the fit's own intervals have it."""
    known = {one.name: one.column for one in fit.sought}
    by_model, by_shots = np.array([deviations(fit, known[name]) for name in fit.belief.names]).T
    return np.where(fit.fitted.model.data.filmed & (by_shots > BEYOND * by_model), by_shots / by_model, 1.0)


def _prior(fit: MapFit) -> tuple[Float[Array, " p"], Float[Array, " p"]]:
    """(centre, standard deviation) of the belief's numbers on their scales, as the fit had them."""
    known = {one.name: one for one in fit.sought}
    centre, sd = [], []
    for name, number in zip(fit.belief.names, fit.belief.values(), strict=True):
        one = known[name]
        at = float(fit.scores.point[one.column])
        slope = own_slope(fit.scores.columns[one.column].name, at, fit.catalogue)
        centre.append(number + (one.centre - at) / slope)
        sd.append(one.sd / abs(slope))
    return np.array(centre), np.array(sd)


def _positive(matrix: Float[Array, "p p"]) -> Float[Array, "p p"]:
    """Without what rounding made negative."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)
