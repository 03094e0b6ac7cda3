"""Profile-likelihood intervals: how far one parameter can go while all others adjust (Raue et al. 2009).

A Hessian describes the optimum's neighbourhood; a profile walks until the fit has really become worse, and tells
whether it was the data that stopped it or only the prior. The walk is along the profile adjusted for how sharply the
others are determined there (Cox and Reid 1987; Laplace's approximation of the marginal posterior): minus log posterior
plus half the log determinant of the others' curvature. Without it a scatter, fitted beside the coefficients that chase
the same shots, comes out too small and its interval too short (benchmarks/coverage.py: 0.845 of 200 instead of 0.9).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from truearc.sim.infer.map_fit import MapFit
from truearc.sim.infer.optimum import Optimum, minimise

Z90 = 1.6448536269514722              # two-sided 90 %
TOLERANCE = 0.02                      # of Z90, in which an end is accepted
MOST_STEPS = 12
WIDEST_U = 8.0                        # prior standard deviations from the optimum; further is open
GROUND_STEPS = 4
GROUND_WIDTH = 0.3                    # standard errors, of the differences
GROUND_NEAR = 0.1                     # standard errors: a step this short is the last


@dataclass(frozen=True)
class ProfileInterval:
    """90 % interval of one parameter in its own unit.

    `low_by_data`, `high_by_data`: most of what stopped the walk on that side is data, not prior. An end that was never
    reached is infinite in `closed` terms: closed False, and the end is where the walk stopped.
    """

    name: str
    value: float
    low90: float
    high90: float
    low_by_data: bool
    high_by_data: bool
    closed: bool


def profile_interval(fit: MapFit, name: str) -> ProfileInterval:
    """The profile interval of one fitted parameter."""
    index = fit.model.names.index(name)
    ground = _ground(fit, index)
    low, low_data, low_closed = _walk(fit, index, ground, -1.0)
    high, high_data, high_closed = _walk(fit, index, ground, 1.0)
    one = fit.model.sought[index]
    return ProfileInterval(name, float(one.value(fit.optimum.u[index])), float(one.value(low)), float(one.value(high)),
                    low_data, high_data, low_closed and high_closed)


def deviance_at(fit: MapFit, name: str, value: float) -> float:
    """Twice the adjusted log posterior lost with one parameter held at `value`; at most 2.706 inside its interval."""
    index = fit.model.names.index(name)
    held = minimise(fit.problem, _shifted(fit, fit.optimum, index, fit.model.sought[index].u(value)), held=(index,))
    return 2.0 * (_cost(held, index) - _ground(fit, index).cost)


class _Ground(NamedTuple):
    """The least adjusted cost, how far from the optimum along the parameter it lies, and the optimum there."""

    cost: float
    step: float
    there: Optimum


def _ground(fit: MapFit, index: int) -> _Ground:
    """Newton's method in one dimension, slope and curvature of the adjusted profile by differences."""
    se = float(np.sqrt(fit.covariance[index, index]))
    best, there = _Ground(_cost(fit.optimum, index), 0.0, fit.optimum), fit.optimum
    step = 0.0
    for _ in range(GROUND_STEPS):
        costs = []
        for offset in (-GROUND_WIDTH * se, GROUND_WIDTH * se):
            there = minimise(fit.problem, _shifted(fit, best.there, index, fit.optimum.u[index] + step + offset),
                             held=(index,))
            costs.append(_cost(there, index))
        slope = 0.5 * (costs[1] - costs[0]) / GROUND_WIDTH
        bend = max((costs[0] - 2.0 * best.cost + costs[1]) / GROUND_WIDTH**2, 0.25)
        step += se * float(np.clip(-slope / bend, -1.0, 1.0))
        there = minimise(fit.problem, _shifted(fit, best.there, index, fit.optimum.u[index] + step), held=(index,))
        cost = _cost(there, index)
        if cost >= best.cost:
            return best
        best = _Ground(cost, step, there)
        if abs(slope / bend) < GROUND_NEAR:
            return best
    return best


def _cost(there: Optimum, index: int) -> float:
    """Minus the log posterior with the others integrated out, up to a constant."""
    free = [other for other in range(len(there.u)) if other != index]
    return there.value + 0.5 * float(np.linalg.slogdet(there.hessian[np.ix_(free, free)])[1]) if free else there.value


def _walk(fit: MapFit, index: int, ground: _Ground, sign: float) -> tuple[float, bool, bool]:
    """(u of the end, closed by data, closed) on one side, by secants on the signed root of the deviance."""
    centre = fit.optimum.u[index] + ground.step
    inside, outside = (0.0, 0.0), None
    step = sign * Z90 * np.sqrt(fit.covariance[index, index])
    there = ground.there
    for _ in range(MOST_STEPS):
        step = float(np.clip(step, -WIDEST_U, WIDEST_U))
        there = minimise(fit.problem, _shifted(fit, there, index, centre + step), held=(index,))
        root = np.sqrt(2.0 * max(_cost(there, index) - ground.cost, 0.0))
        if abs(root - Z90) < TOLERANCE * Z90:
            return centre + step, _by_data(ground, there, index), True
        if root < Z90:
            if abs(step) >= WIDEST_U:
                return centre + step, False, False
            inside = (step, root)
        else:
            outside = (step, root)
        step = _next(inside, outside, sign)
    closed = outside is not None      # else the walk ended before anything stopped it
    return centre + step, closed and _by_data(ground, there, index), closed


def _next(inside: tuple[float, float], outside: tuple[float, float] | None, sign: float) -> float:
    """Where the root is Z90 by a straight line; well inside the bracket, and never more than thrice as far."""
    if outside is None:
        slope = inside[1] / inside[0] if inside[0] else 0.0
        return inside[0] * 3.0 if 3.0 * inside[1] < Z90 else Z90 / slope * 1.02
    (a, at_a), (b, at_b) = inside, outside
    step = a + (b - a) * (Z90 - at_a) / max(at_b - at_a, 1e-12)
    margin = 0.05 * abs(b - a)
    low, high = sorted((a, b))
    return float(np.clip(step, low + margin, high - margin))


def _shifted(fit: MapFit, there: Optimum, index: int, to: float) -> Float[np.ndarray, " p"]:
    """The point on the ridge where the parameter is `to`, were the posterior normal about the last point."""
    u = there.u.copy()
    free = [other for other in range(len(u)) if other != index]
    move = to - u[index]
    if free:
        inner = np.linalg.lstsq(there.hessian[np.ix_(free, free)], -there.hessian[free, index] * move, rcond=1e-8)[0]
        u[free] += np.clip(inner, -1.0, 1.0)
    u[index] = to
    return u


def _by_data(ground: _Ground, there: Optimum, index: int) -> bool:
    """Whether the data's share of what was lost, the others' room included, is the greater."""
    lost = _cost(there, index) - ground.cost
    by_prior = 0.5 * float(there.u @ there.u - ground.there.u @ ground.there.u)
    return lost - by_prior > 0.5 * lost
