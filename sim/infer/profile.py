"""Profile-likelihood intervals: how far one parameter can go while all others adjust (Raue et al. 2009).

A Hessian describes the optimum's neighbourhood; a profile walks until the fit has really become worse, and tells
whether it was the data that stopped it or only the prior. The walk is along the profile adjusted for how sharply the
others are determined there (Cox and Reid 1987; Laplace's approximation of the marginal posterior): minus log posterior
plus half the log determinant of the others' curvature. Without it a scatter, fitted beside the coefficients that chase
the same shots, comes out too small and its interval too short.

Flights are linear about the optimum on the way; at each end so found they are flown again, and the end is put right.

Where a simulation lacks what tracks show, they contradict each other by many times their noise, and no likelihood says
how far off a parameter is. What shots say of it one by one still does (the sandwich estimate: Huber 1967, White 1982).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import brentq, minimize_scalar

from truearc.sim.infer.baseline_fit import climb, limits_of, moved
from truearc.sim.infer.held_out import fit_linear, log_posterior
from truearc.sim.infer.likelihood.score_table import ScoreTable
from truearc.sim.infer.map_fit import MapFit
from truearc.sim.infer.parameters import Sought

Z90 = 1.6448536269514722              # two-sided 90 %
WIDEST = 8.0                          # prior standard deviations from the optimum; further is open
GROWTH = 1.5                          # of a step that has not yet come to the end
NEARBY = 1.5                          # standard errors, in which the adjusted optimum is looked for
TOLERANCE = 0.02                      # of Z90, in which an end is accepted
PUT_RIGHT = 4                         # flights at most
KNOWN = 0.7                           # of the prior's deviation, below which most of what is known is by data
BEYOND = 1.5                          # times the deviation by the likelihood, from which that by the shots counts
MOST_PUT_RIGHT = 2.0                  # factor by which flying again may move an end


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


class _Profile:
    """Of one parameter, as a function of how far its column is from the optimum."""

    def __init__(self, fit: MapFit, one: Sought) -> None:
        self.fit, self.one = fit, one
        self.free: Bool[np.ndarray, " P"] = np.arange(len(fit.evidence.columns)) != one.column
        self.train = np.full(len(fit.evidence.rows), True)
        covariance = fit.evidence.covariance
        self.se = float(np.sqrt(covariance[one.column, one.column]))
        self.ridge = covariance[:, one.column] / covariance[one.column, one.column]
        point = float(fit.evidence.point[one.column])
        low, high = limits_of(fit.fitted.layout, one.column)
        self.limits = low - point, high - point
        found = minimize_scalar(lambda step: self.at(step).cost, method="bounded", options={"xatol": 0.02 * self.se},
                                bounds=(max(-NEARBY * self.se, self.limits[0]), min(NEARBY * self.se, self.limits[1])))
        best = min((0.0, float(found.x)), key=lambda step: self.at(step).cost)
        self.middle, self.ground = best, self.at(best)

    def at(self, step: float) -> _Held:
        """With flights linear about the optimum."""
        evidence = self.fit.evidence
        change = fit_linear(evidence, self.train, self.ridge * step, self.free)
        info = evidence.deal.total(evidence.slopes_at(np.tile(change, (len(self.train), 1)))[1])
        return self._held(-log_posterior(evidence, change, self.train), info, change)

    def flown(self, change: Float[np.ndarray, " P"]) -> _Held:
        """With flights from there, the others at their best again."""
        fitted = self.fit.fitted
        scatters = [column for column in fitted.layout.scatters if column >= 0]
        spot, parts = fitted.spot, int(np.ceil(np.abs(change[scatters]).max(initial=1.0)))
        for _ in range(parts):        # a scatter's logarithm moves by 1 at most at a time
            spot = moved(fitted.layout, spot, change / parts)
        _, evidence = climb(fitted.intake, fitted.layout, spot, held=~self.free)
        found = evidence.point - self.fit.evidence.point
        lost = self._value(self.fit.evidence) - self._value(evidence)
        return self._held(lost, evidence.information, found)

    def _value(self, evidence: ScoreTable) -> float:
        off = evidence.point - self.fit.fitted.layout.centre
        return float(evidence.log_score.sum() - 0.5 * off @ evidence.precision @ off)

    def _held(self, lost: float, info: Float[np.ndarray, "P P"], change: Float[np.ndarray, " P"]) -> _Held:
        evidence = self.fit.evidence
        others = (info + evidence.precision)[self.free][:, self.free]
        by_prior = float(0.5 * change @ evidence.precision @ change - evidence.pull @ change)
        return _Held(lost + 0.5 * float(np.linalg.slogdet(others)[1]), change, by_prior)

    def root(self, held: _Held) -> float:
        return float(np.sqrt(2.0 * max(held.cost - self.ground.cost, 0.0)))

    def end(self, sign: float) -> tuple[float, bool, bool]:
        """(step of the end on one side, closed by data, closed)."""
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
        by_data = lost - (held.by_prior - self.ground.by_prior) > 0.5 * lost
        return exact, by_data, True


def profile_interval(fit: MapFit, name: str) -> ProfileInterval:
    """The profile interval of one fitted parameter; with tracks, which make it normal, by the information, or by how
    shots differ where they contradict each other."""
    one = fit.sought[fit.names.index(name)]
    point = float(fit.evidence.point[one.column])
    if fit.fitted.intake.filmed:
        by_model, by_shots = deviations(fit, one.column)
        sd = by_shots if by_shots > BEYOND * by_model else by_model
        least, most = limits_of(fit.fitted.layout, one.column)
        low, high = max(point - Z90 * sd, least), min(point + Z90 * sd, most)
        by_data = bool(by_model < KNOWN * one.sd)
        return ProfileInterval(name, one.value(point), one.value(low), one.value(high), by_data and low > least,
                               by_data and high < most, True)
    walk = _Profile(fit, one)
    low, low_data, low_closed = walk.end(-1.0)
    high, high_data, high_closed = walk.end(1.0)
    return ProfileInterval(name, one.value(point), one.value(point + low), one.value(point + high), low_data, high_data,
                           low_closed and high_closed)


def deviations(fit: MapFit, column: int) -> tuple[float, float]:
    """Standard deviations of a column: by the information, and by how scores differ between shots, or between balls."""
    evidence = fit.evidence
    covariance = evidence.covariance
    together = fit.fitted.together
    score = np.zeros((together.max() + 1, len(evidence.columns)))
    np.add.at(score, together, evidence.score)
    return float(np.sqrt(covariance[column, column])), float(np.linalg.norm(score @ covariance[column]))


def deviance_at(fit: MapFit, name: str, value: float) -> float:
    """Twice the adjusted log posterior lost with one parameter held at `value`; at most 2.706 inside its interval."""
    one = fit.sought[fit.names.index(name)]
    walk = _Profile(fit, one)
    there = walk.flown(walk.at(one.at(value) - float(fit.evidence.point[one.column])).change)
    return 2.0 * (there.cost - walk.ground.cost)
