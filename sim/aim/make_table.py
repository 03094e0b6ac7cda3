"""The table of set points by a belief, with what errors cost and the band of speeds that score; and its picture."""

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Rig
from truearc.sim.aim.solve import LEAST_POINTS, SAFE_SHARE, Chances, Solved, chances_of, solve
from truearc.sim.data.dataset import Shots
from truearc.sim.infer.belief import Belief, before_the_shot
from truearc.sim.infer.forecast import Values, configured
from truearc.sim.infer.likelihood.data import Given, given_of
from truearc.sim.physics.catalogue import Catalogue, flight_terms
from truearc.sim.physics.flight import make_law, reach_plane
from truearc.sim.printed import Progress
from truearc.sim.report import new_panels

RPM = 60.0 / (2.0 * math.pi)          # of one rad/s
DISTANCE_M, HOOD_DEG, SPEED_RPM = 0.10, 1.0, 50.0       # errors whose cost is reported
BAND = np.linspace(-0.25, 0.25, 101)  # of the log of the motor's speed, in which the band is sought
ROWS_AT_ONCE = 64

Rows = Float[np.ndarray, " n"]


class AimRow(NamedTuple):
    """A set point.

    Fields:
        distance_m: For which it is.
        hood_deg: Launch elevation.
        motor_ratio: Motor speed over free speed.
        motor_rad_s: Motor speed.
        lead_deg: By how much to aim to the left of the target, against wind across.
        flight_s: From the exit to the target.
        p_two, p_three: Probability of at least two points, and of three.
        points: Expected.
        lost_10cm, lost_1deg, lost_50rpm: Points that such an error of distance, hood or motor speed costs, the mean of
            both directions.
        slowest_rad_s, fastest_rad_s: Motor speeds between which at least half of the points are left.
        note: What of it is outside the range of the shots that the belief was fitted to.
    """

    distance_m: float
    hood_deg: float
    motor_ratio: float
    motor_rad_s: float
    lead_deg: float
    flight_s: float
    p_two: float
    p_three: float
    points: float
    lost_10cm: float
    lost_1deg: float
    lost_50rpm: float
    slowest_rad_s: float
    fastest_rad_s: float
    note: str


def make_rows(rig: Rig, belief: Belief, distance_m: Rows, hood_deg: tuple[float, float],
              progress: Progress) -> tuple[tuple[AimRow, ...], tuple[tuple[float, str], ...]]:
    """Set points of ascending distances [n] in m, and the distances without one with the reason; hood_deg: limits.

    InputError where no distance has a set point that scores.
    """
    solved = solve(rig, belief, distance_m, hood_deg, progress)
    scores = np.array([not reason for reason in solved.reason]) & (solved.chances.points >= LEAST_POINTS)
    refused = tuple((float(distance_m[row]), solved.reason[row] or "no set point near its neighbours' scores")
                    for row in np.flatnonzero(~scores))
    if not scores.any():
        raise InputError(f"distances_m: no distance has a set point that scores: {refused[0][1]}")
    return tuple(_rows(rig, belief, distance_m, solved, np.flatnonzero(scores))), refused


def _rows(rig: Rig, belief: Belief, distance_m: Rows, solved: Solved, kept: np.ndarray) -> Iterator[AimRow]:
    at = (distance_m[kept], solved.hood_deg[kept], solved.motor_ratio[kept])
    best = chances_of(rig, belief, *at)
    free_rad_s = rig.launcher.free_speed_rad_s or 0.0
    lost = [_lost(rig, belief, at, best, place, error) for place, error in enumerate(
        (DISTANCE_M, HOOD_DEG, SPEED_RPM / RPM / free_rad_s))]
    low, high = _band(rig, belief, at, best)
    lead, flight_s = lead_deg(rig, belief, *at), flown(rig, belief, *at)[1]
    fitted = belief.provenance.get("range", {})
    for row in range(len(kept)):
        numbers = (*(float(column[row]) for column in at), float(at[2][row] * free_rad_s), float(lead[row]),
                   float(flight_s[row]),
                   *(float(column[row]) for column in (best.p_two, best.p_three, best.points, *lost)),
                   float(low[row] * free_rad_s), float(high[row] * free_rad_s))
        settings = dict(zip(("distance_m", "hood_deg", "motor_ratio"), numbers, strict=False))
        yield AimRow._make([*numbers, beyond(settings, fitted if isinstance(fitted, Mapping) else {})])


def _lost(rig: Rig, belief: Belief, at: tuple[Rows, Rows, Rows], best: Chances, place: int, error: float) -> Rows:
    """Points that an error of one of the three costs, the mean of both directions; place: which of `at` is wrong."""
    off = []
    for sign in (-1.0, 1.0):
        moved = [column + sign * error if index == place else column for index, column in enumerate(at)]
        off.append(chances_of(rig, belief, *moved).points)
    return np.asarray(best.points - 0.5 * (off[0] + off[1]))


def _band(rig: Rig, belief: Belief, at: tuple[Rows, Rows, Rows], best: Chances) -> tuple[Rows, Rows]:
    """Lowest and highest ratio around each set point with at least SAFE_SHARE of its points."""
    low, high = at[2].copy(), at[2].copy()
    for first in range(0, len(low), ROWS_AT_ONCE):
        rows = slice(first, first + ROWS_AT_ONCE)
        ratio = np.minimum(at[2][rows, None] * np.exp(BAND), 1.0)
        distance_m, hood_deg = (np.repeat(column[rows], len(BAND)) for column in at[:2])
        points = chances_of(rig, belief, distance_m, hood_deg, ratio.ravel()).points.reshape(ratio.shape)
        good = points >= SAFE_SHARE * best.points[rows, None]
        middle = len(BAND) // 2
        below = np.argmin(np.c_[good[:, middle::-1], np.zeros(len(good), bool)], axis=1) - 1
        above = np.argmin(np.c_[good[:, middle:], np.zeros(len(good), bool)], axis=1) - 1
        row = np.arange(len(good))
        low[rows] = ratio[row, middle - np.maximum(below, 0)]
        high[rows] = ratio[row, middle + np.maximum(above, 0)]
    return low, high


def beyond(settings: Mapping[str, float], fitted: Mapping[str, list[float]]) -> str:
    """What of a set point is outside the range of the shots that a belief was fitted to; "" where nothing is."""
    return "; ".join(f"{name} beyond the fitted {fitted[name][0]:.3g} to {fitted[name][1]:.3g}"
                     for name, value in settings.items()
                     if name in fitted and not fitted[name][0] - 1e-9 <= value <= fitted[name][1] + 1e-9)


def lead_deg(rig: Rig, belief: Belief, distance_m: Float[np.ndarray, " n"], hood_deg: Float[np.ndarray, " n"],
             motor_ratio: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Angle by which to turn the launcher to the left [n], in degrees, against the drift; NaN: does not come there."""
    side_m = flown(rig, belief, distance_m, hood_deg, motor_ratio)[0]
    return np.asarray(np.degrees(np.arctan2(-side_m, distance_m)) + 0.0)


def flown(rig: Rig, belief: Belief, distance_m: Float[np.ndarray, " n"], hood_deg: Float[np.ndarray, " n"],
          motor_ratio: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """(drift to the left in m [n], time of flight in s [n]) at the target; NaN: does not come there."""
    shots = Shots(tuple(map(str, range(len(distance_m)))),
                  {"distance_m": distance_m, "hood_deg": hood_deg, "motor_ratio": motor_ratio}, {})
    given = given_of(rig, shots, before_the_shot(belief.curves, rig, shots))
    side_m, flown_s = _flown(rig, belief.coefficients, given, belief.catalogue)
    return np.asarray(side_m), np.asarray(flown_s)


@partial(jax.jit, static_argnames=("rig", "among"))
def _flown(rig: Rig, values: Values, given: Given, among: Catalogue) -> tuple[Any, Any]:
    at, exit, distance_m = configured(rig, values, given, among)
    law = make_law(rig, flight_terms({"gravity", *values}, among), at)
    plane = reach_plane(rig, law, exit, distance_m, timed=True)
    nan = jax.numpy.nan
    return jax.numpy.where(plane.near, plane.side_m, nan), jax.numpy.where(plane.near, plane.flown_s, nan)


def draw_aim(rows: Sequence[Any], refused: Sequence[tuple[float, str]]) -> Figure:
    """Hood angle, motor speed with the band in which half of the points are left, and probabilities, over distance."""
    figure, (hood, speed, chance) = new_panels(7.0, 7.0, 3, sharex=True)
    x = np.array([row.distance_m for row in rows])
    hood.plot(x, [row.hood_deg for row in rows], "o-", color="#1b5e9b", markersize=3)
    hood.set_ylabel("hood, deg")
    speed.fill_between(x, [row.slowest_rad_s * RPM for row in rows], [row.fastest_rad_s * RPM for row in rows],
                       color="#9cc4e4", label="at least half of the points")
    speed.plot(x, [row.motor_rad_s * RPM for row in rows], "o-", color="#1b5e9b", markersize=3, label="set point")
    speed.set_ylabel("motor, rpm")
    speed.legend(frameon=False)
    threes = [row.p_three for row in rows]
    chance.plot(x, [row.p_two for row in rows], color="#d9822b", label="two or three points" if any(threes) else "hit")
    if any(threes):
        chance.plot(x, threes, color="#2b8a3e", label="three points")
    chance.set(ylim=(0.0, 1.02), ylabel="probability", xlabel="distance, m")
    chance.legend(frameon=False)
    for distance_m, _ in refused:
        for axes in (hood, speed, chance):
            axes.axvline(distance_m, color="#b02a37", linewidth=1, linestyle=":")
    return figure
