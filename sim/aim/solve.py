"""The search for the set point with the most expected points at each distance.

Among set points that score nearly equally, it chooses a sequence that is smooth over distance. The probability that a
set point scores follows from the belief's forecast of the height at the target.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.special import ndtr

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.targets import POINTS
from truearc.sim.data.dataset import Shots
from truearc.sim.infer.belief import Belief
from truearc.sim.infer.forecast import forecast
from truearc.sim.infer.landing_forecast import forecast_landings
from truearc.sim.physics.simulate import opening_of
from truearc.sim.printed import Progress

STEP_DEG = 1.0                        # of the hood angles that are tried
RATIOS = np.geomspace(0.08, 1.0, 20)  # motor speeds over free speed, between which the height is interpolated
NEWTON, POLISH = 3, 2                 # steps to the ratio that meets the centre, and rounds around it
REACH = 1.5                           # half-width of the first round, in openings' half heights
TRIED = 9                             # ratios of a round
STIFF_POINTS_M = 5e-4                 # what a change of the hood by a degree per metre may cost
NEAR_M = 0.5                          # distances whose hood angles are made a smooth row
ROUNDING_POINTS = 3e-3                # what that may cost
SPIN_UP_POINTS = 0.02                 # and going from rest to free speed: of what is equally good, the slower
OUTER, OUTER_POINTS = 0.2, 0.5        # share of the fitted hood angles at either end, and what their very end may cost
LEAST_POINTS = 0.02                   # expected; with less a distance is refused
# Chosen: as wide as a hub allows for; of set points that hit almost surely, the one with the widest margin then wins
WIDER = 3.0                           # times the spread, for the search of set points at an opening that faces up
SAFE_SHARE = 0.5                      # of the best points, which set points within the band have at least

Rows = Float[np.ndarray, " n"]


@dataclass(frozen=True, eq=False)
class Chances:
    """Probabilities of set points, arrays [n].

    p_two: the ball passes the opening (including its inner part); p_three: its inner part; points: expected; for a
    hit-or-miss target p_three is 0. worth: points of the two. off_m: from the opening's middle, upward or, where it
    faces up, along; NaN if the ball does not reach it, with probabilities 0. per_log_speed: derivative of that by the
    log of the exit speed.
    """

    off_m: Rows
    p_two: Rows
    p_three: Rows
    per_log_speed: Rows
    worth: tuple[float, float]

    @property
    def points(self) -> Rows:
        outer, inner = self.worth
        return outer * self.p_two + (inner - outer) * self.p_three


def chances_of(rig: Rig, belief: Belief, distance_m: Rows, hood_deg: Rows, motor_ratio: Rows, *,
               wider: float = 1.0) -> Chances:
    """Return probabilities under the belief's covariance, the launcher's scatter and the sensors' noise.

    wider: times the spread, at an opening that faces up.

    InputError where the rig has no target or no free speed.
    """
    shots = Shots.of_settings(distance_m, hood_deg, motor_ratio)
    opening, target = opening_of(rig, belief.coefficients, belief.catalogue), rig.target
    assert target is not None
    if target.faces_up:
        lands = forecast_landings(rig, belief, shots, led=True, wider=wider)
        chance = lands.seen.class_chances(lands.mean_m, lands.spread_m, lapses=False) * lands.reached[:, None]
        off_m = np.where(lands.reached, lands.mean_m - lands.seen.centred(lands.mean_m), np.nan)
        return Chances(off_m, chance[:, 1] + chance[:, 2], chance[:, 2], lands.per_log_speed, target.worth)
    seen = forecast(rig, belief, shots)
    two, three = (_between(seen.height_m - opening.centre_m, half_m, seen.sigma_m)
                  for half_m in (opening.two_half_m, opening.three_half_m))
    return Chances(seen.height_m - opening.centre_m, two, three, seen.by_launch[:, 0], target.worth)


def _between(off_m: Rows, half_m: float, sigma_m: Rows) -> Rows:
    with np.errstate(divide="ignore", invalid="ignore"):
        p = ndtr((half_m - off_m) / sigma_m) - ndtr((-half_m - off_m) / sigma_m)
    exact = (np.abs(off_m) <= half_m).astype(float) if half_m > 0.0 else np.zeros_like(off_m)
    return np.nan_to_num(np.where(sigma_m > 0.0, p, exact))


class Solved(NamedTuple):
    """Set points [n], a row per distance; nothing scores where `points` is below LEAST_POINTS."""

    hood_deg: Rows
    motor_ratio: Rows
    chances: Chances
    reason: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Field:
    """Best ratio [n, m] at every distance [n] and hood angle [m], and the points there."""

    hood_deg: Float[np.ndarray, " m"]
    motor_ratio: Float[np.ndarray, "n m"]
    points: Float[np.ndarray, "n m"]
    reason: Int[np.ndarray, "n m"]


REASONS = ("no set point scores", "the ball does not come so far at the motors' free speed",
           "the ball passes above the target even at the lowest speed",
           "no ball comes so high at the motors' free speed")


def solve(rig: Rig, belief: Belief, distance_m: Rows, hood_deg: tuple[float, float],
          progress: Progress = lambda done, note: None) -> Solved:
    """Solve for the best set point of each ascending distance, with a hood angle within `hood_deg` (lowest,
    highest)."""
    if rig.launcher.free_speed_rad_s is None or not rig.launcher.wheel:
        raise InputError("rig.toml: launcher: free_speed_rad_s and a wheel are needed to aim")
    count = max(round((hood_deg[1] - hood_deg[0]) / STEP_DEG), 0) + 1
    field = _search(rig, belief, distance_m, np.linspace(*hood_deg, count), progress)
    assert rig.target is not None      # or there are no chances
    path = _smooth_path(field, distance_m, _outer_cost(belief, field.hood_deg), rig.target.worth[1] / POINTS[1])
    rows = np.arange(len(distance_m))
    found = field.hood_deg[path]
    smooth = _rounded_off(found, distance_m, hood_deg)
    rounded = _ratios(rig, belief, distance_m, smooth, field.motor_ratio[rows, path])
    lost = field.points[rows, path] - chances_of(rig, belief, distance_m, smooth, rounded, wider=WIDER).points
    hood = np.where(lost > ROUNDING_POINTS, found, smooth)
    ratio = np.where(lost > ROUNDING_POINTS, field.motor_ratio[rows, path], rounded)
    chances = chances_of(rig, belief, distance_m, hood, ratio)
    best = field.points.max(axis=1)
    reasons = tuple("" if best[row] >= LEAST_POINTS else REASONS[int(np.bincount(field.reason[row]).argmax())]
                    for row in rows)
    progress(1.0, f"{len(distance_m)} distances")
    return Solved(hood, ratio, chances, reasons)


def best_ratios(rig: Rig, belief: Belief, distance_m: Rows, hood_deg: Rows) -> tuple[Rows, Chances]:
    """Return the best motor speed over free speed [n] at a distance with a given hood angle, and its chances."""
    ratio = _ratios(rig, belief, distance_m, hood_deg, _starts(rig, belief, distance_m, hood_deg)[0])
    return ratio, chances_of(rig, belief, distance_m, hood_deg, ratio)


def _search(rig: Rig, belief: Belief, distance_m: Rows, hood_deg: Float[np.ndarray, " m"],
            progress: Progress) -> _Field:
    n, m = len(distance_m), len(hood_deg)
    ratio, reason = np.empty((n, m)), np.zeros((n, m), int)
    for row, distance in enumerate(distance_m):
        ratio[row], reason[row] = _starts(rig, belief, np.full(m, distance), hood_deg)
        progress(0.8 * (row + 1) / n, f"{row + 1} of {n} distances")
    flat = np.repeat(distance_m, m), np.tile(hood_deg, n)
    best = _ratios(rig, belief, *flat, ratio.ravel())
    points = chances_of(rig, belief, *flat, best, wider=WIDER).points
    return _Field(hood_deg, best.reshape(n, m), points.reshape(n, m), reason)


def _starts(rig: Rig, belief: Belief, distance_m: Rows, hood_deg: Rows) -> tuple[Rows, Int[np.ndarray, " n"]]:
    """About the ratio at which the ball meets the centre's height, and why there is none: index of REASONS."""
    grid = chances_of(rig, _certain(rig, belief), np.repeat(distance_m, len(RATIOS)), np.repeat(hood_deg, len(RATIOS)),
                      np.tile(RATIOS, len(hood_deg)))
    ratio, reason = zip(*map(_crossing, grid.off_m.reshape(len(hood_deg), -1)), strict=True)
    return np.array(ratio), np.array(reason)


def _certain(rig: Rig, belief: Belief) -> Belief:
    """The belief without its covariance, by which flights reach the same height; their derivatives by its numbers cost
    most of a forecast. At an opening that faces up, the middle of the places follows the spread."""
    if rig.target is None or rig.target.faces_up:
        return belief
    return replace(belief, names=(), covariance=np.zeros((0, 0)))


def _crossing(off_m: Float[np.ndarray, " ratios"]) -> tuple[float, int]:
    """The ratio at which a height that grows with it meets the centre, and why there is none: index of REASONS."""
    known = np.isfinite(off_m)
    if not known.any() or off_m[known].max() < 0.0:
        return float(RATIOS[-1]), 1 if known.any() else 3
    first = int(np.flatnonzero(known & (off_m >= 0.0))[0])
    if first == 0 or not known[first - 1]:
        return float(RATIOS[first]), 2 if first == 0 else 0
    share = off_m[first - 1] / (off_m[first - 1] - off_m[first])
    return float(RATIOS[first - 1] * (RATIOS[first] / RATIOS[first - 1])**share), 0


def _ratios(rig: Rig, belief: Belief, distance_m: Rows, hood_deg: Rows, start: Rows) -> Rows:
    """The ratios with the most points near those where a height meets the target's centre."""
    opening = opening_of(rig, belief.coefficients, belief.catalogue)
    ratio, certain = start, _certain(rig, belief)
    for _ in range(NEWTON):
        at = chances_of(rig, certain, distance_m, hood_deg, ratio)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = -at.off_m / at.per_log_speed
        ratio = np.clip(ratio * np.exp(np.clip(np.nan_to_num(step), -0.1, 0.1)), RATIOS[0], 1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        half = np.clip(np.nan_to_num(REACH * opening.two_half_m / np.abs(at.per_log_speed), nan=0.05), 1e-3, 0.2)
    for _ in range(POLISH):
        tried = np.clip(ratio[:, None] * np.exp(half[:, None] * np.linspace(-1.0, 1.0, TRIED)), RATIOS[0], 1.0)
        points = chances_of(rig, belief, np.repeat(distance_m, TRIED), np.repeat(hood_deg, TRIED), tried.ravel(),
                            wider=WIDER).points
        ratio = _peak(tried, points.reshape(-1, TRIED))
        half = half / TRIED * 2.0
    return ratio


def _peak(tried: Float[np.ndarray, "k t"], points: Float[np.ndarray, "k t"]) -> Rows:
    """Where the parabola through the best of each row and its neighbours has its top; of equals, their middle."""
    row = np.arange(len(tried))
    flat = points >= points.max(axis=1, keepdims=True) - 1e-12
    best = np.clip(np.round((flat * np.arange(tried.shape[1])).sum(1) / flat.sum(1)).astype(int), 1, tried.shape[1] - 2)
    low, top, high = (points[row, best + step] for step in (-1, 0, 1))
    bend = low - 2.0 * top + high
    with np.errstate(divide="ignore", invalid="ignore"):
        shift = np.where(bend < 0.0, 0.5 * (low - high) / bend, 0.0)
    shift = np.clip(np.nan_to_num(shift), -1.0, 1.0)
    place = np.log(tried[row, best])
    step = np.where(shift < 0.0, place - np.log(tried[row, best - 1]), np.log(tried[row, best + 1]) - place)
    return np.asarray(np.exp(place + shift * step))


def _outer_cost(belief: Belief, hood_deg: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
    """Points [m] by which a hood angle must be better near the ends of those that the belief was fitted to: there shots
    lie to one side alone, and of many set points the best is where a belief errs to its advantage."""
    fitted = belief.provenance.get("range", {})
    low, high = fitted.get("hood_deg", (0.0, 0.0)) if isinstance(fitted, Mapping) else (0.0, 0.0)
    if not high > low:
        return np.zeros(len(hood_deg))
    inside = np.minimum(hood_deg - low, high - hood_deg) / (OUTER * (high - low))
    return np.asarray(OUTER_POINTS * np.clip(1.0 - inside, 0.0, 1.0))


def _smooth_path(field: _Field, distance_m: Rows, outer: Float[np.ndarray, " m"],
                 worth: float) -> Int[np.ndarray, " n"]:
    """The hood angle [n] (index) of each distance: most points, less what its changes and the speeds cost, and
    `outer` [m] what the angle itself does; worth: of the best hit, as a share of the three that the costs are of."""
    cost = SPIN_UP_POINTS * field.motor_ratio - field.points / worth + outer
    change = STIFF_POINTS_M * np.abs(field.hood_deg[:, None] - field.hood_deg)
    total, back = cost[0], np.zeros(cost.shape, int)
    for row in range(1, len(distance_m)):
        ways = total[:, None] + change / (distance_m[row] - distance_m[row - 1])
        back[row] = ways.argmin(axis=0)
        total = ways.min(axis=0) + cost[row]
    path = np.empty(len(distance_m), int)
    path[-1] = total.argmin()
    for row in range(len(distance_m) - 1, 0, -1):
        path[row - 1] = back[row, path[row]]
    return path


def _rounded_off(hood_deg: Rows, distance_m: Rows, limits: tuple[float, float]) -> Rows:
    """Without the steps of the grid: weighted means of each angle's neighbours."""
    weight = np.maximum(1.0 - np.abs(distance_m[:, None] - distance_m) / NEAR_M, 0.0)
    return np.asarray(np.clip((weight @ hood_deg) / weight.sum(axis=1), *limits))
