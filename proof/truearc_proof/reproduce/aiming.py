"""Where a crew sets the launcher to get hits, near misses and misses in similar numbers, learnt from their own marks.

Speeds are vacuum ballistics' times a correction, a quadratic in distance and elevation fitted to the marks. No drag,
lift or wheel slip is supposed, so the choice of configurations favours no simulator.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit
from scipy.stats import norm
from sklearn.linear_model import LogisticRegression

from truearc.robot.aim import FEASIBLE_DEG, vacuum_speed_m_s
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.schema import Collect, Prescribed
from truearc.sim.data.dataset import Shots
from truearc_proof.reproduce.paper import exit_seed

DISTANCES_M = (2.6, 8.0)
RATIOS = (0.15, 0.95)                 # what the wheels do
CENTRE_M, SPAN_M, CENTRE_DEG, SPAN_DEG = 5.0, 2.0, 45.0, 8.0
STRENGTH = 1000.0                     # inverse of the regression's weight decay: hardly any
PERCENT = 0.01                        # log speed is counted in hundredths, about the other columns' size
LEAST_GAIN_M = 0.5                    # nearly along the line of sight the parabola does not determine the speed
LEAST_P = 1e-4                        # a mark in ten thousand may be anything

# Intended height at the plane beside the centre, either way, for each outcome: least, most (m).
INTENDED_M = {"three": (0.0, 0.01), "two": (0.03, 0.30), "miss": (0.40, 1.50)}
# How many of each must be meant for one to be had: much of what is meant for the centre comes out a two.
TRIES = {"three": 2.5, "two": 1.0, "miss": 1.1}


class Aiming(NamedTuple):
    """log(wheels' speed / vacuum's speed to the centre) that hits the centre = `terms` . levers."""

    terms: np.ndarray


def learn_aiming(rig: Rig, shots: Shots) -> Aiming | None:
    """From marked shots (`side`, `outcome`), by maximum likelihood; None while all misses are on one side.

    A shot passes gain x (log speed - terms . levers) above the centre, with a scatter that is fitted too; a mark says
    between which bounds. Some of what is high enough for the three passes beside it: that share is fitted as well.
    """
    assert rig.target is not None
    columns = [shots.number(name) for name in ("distance_m", "hood_deg", "motor_ratio")]
    log_speed, keep = _log_speed(rig, *columns)
    outcome, side = np.array(shots.text("outcome")), np.array(shots.text("side"))
    cells = np.select([outcome == "three", outcome == "two", side == "high", side == "low"], [0, 1, 2, 3], -1)
    keep &= cells >= 0
    if not {2, 3} <= set(cells[keep].tolist()):
        return None
    levers = _levers(*columns[:2])
    gain_m = np.maximum(_gain_m(rig, *columns[:2]), LEAST_GAIN_M)
    first = _first_guess(log_speed[keep], levers[keep], cells[keep])
    start = np.concatenate([first, [np.log(0.01), np.log(0.05), 1.0]])
    data = (log_speed[keep], levers[keep], gain_m[keep], cells[keep],
            rig.target.three_half_height_m, rig.target.two_half_height_m)
    return Aiming(minimize(_surprise, start, args=data, method="BFGS").x[:levers.shape[1]])


def _surprise(theta: np.ndarray, log_speed: np.ndarray, levers: np.ndarray, gain_m: np.ndarray, cells: np.ndarray,
              three_m: float, two_m: float) -> float:
    """Mean negative log likelihood; theta: terms, logs of the scatter in log speed and in height, log odds beside."""
    terms, (speed, floor_m, beside) = theta[:-3], theta[-3:]
    mean_m = gain_m * (log_speed - levers @ terms)
    sd_m = np.hypot(gain_m * np.exp(speed), np.exp(floor_m))
    below = [norm.cdf((bound - mean_m) / sd_m) for bound in (-two_m, -three_m, three_m, two_m)]
    inside = (below[2] - below[1]) * expit(beside)
    p = np.stack([inside, below[3] - below[0] - inside, 1.0 - below[3], below[0]])
    return -float(np.mean(np.log(np.maximum(p[cells, np.arange(len(cells))], LEAST_P))))


def _first_guess(log_speed: np.ndarray, levers: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Where a logistic regression of high against low is undecided, a hit counting half on either side."""
    columns = np.column_stack([log_speed / PERCENT, levers])
    high, low = cells != 3, cells != 2
    rows, labels = np.concatenate([columns[high], columns[low]]), np.repeat([1, 0], [high.sum(), low.sum()])
    weight = np.concatenate([np.where(cells[part] < 2, 0.5, 1.0) for part in (high, low)])
    fitted = LogisticRegression(C=STRENGTH, fit_intercept=False, max_iter=10000, tol=1e-8).fit(rows, labels, weight)
    slope, *terms = fitted.coef_[0]
    return -np.array(terms) * PERCENT / max(float(slope), 1e-3)


def intentions(lacking: Mapping[str, int]) -> dict[str, float]:
    """Share of the next configurations to be meant for each outcome, by how many of it are lacking (sums to 1)."""
    tries = {outcome: TRIES[outcome] * max(lacking[outcome], 0) for outcome in TRIES}
    total = sum(tries.values())
    return {outcome: count / total if total else 1.0 / len(tries) for outcome, count in tries.items()}


def propose(rig: Rig, collect: Collect, aiming: Aiming, shares: Mapping[str, float], count: int,
            rng: np.random.Generator) -> list[Prescribed]:
    """`count` configurations this launcher can be set to, `shares` of them meant for each outcome.

    By distance, so that little time is spent on driving.
    """
    rows: list[Prescribed] = []
    while len(rows) < count:
        row = _propose_one(rig, collect, aiming, shares, rng)
        if row is not None:
            rows.append(row)
    return sorted(rows, key=lambda row: row.distance_m)


def _propose_one(rig: Rig, collect: Collect, aiming: Aiming, shares: Mapping[str, float],
                 rng: np.random.Generator) -> Prescribed | None:
    assert rig.target is not None
    rise_m = rig.target.centre_height_m - rig.launcher.release_height_m
    distance_m = float(rng.uniform(*DISTANCES_M))
    low_deg = max(collect.hood_low_deg, math.degrees(math.atan2(rise_m, distance_m)) + FEASIBLE_DEG)
    hood_deg = float(rng.uniform(low_deg, max(low_deg, collect.hood_high_deg)))
    outcome = rng.choice(list(INTENDED_M), p=[shares[name] for name in INTENDED_M])
    beside_m = float(rng.choice([-1.0, 1.0]) * rng.uniform(*INTENDED_M[str(outcome)]))
    place = np.array([distance_m]), np.array([hood_deg])
    log_speed = float(aiming.terms @ _levers(*place)[0] + beside_m / _gain_m(rig, *place)[0])
    speed_m_s = vacuum_speed_m_s(distance_m, rise_m, hood_deg, rig.world.gravity_m_s2)
    assert speed_m_s is not None      # FEASIBLE_DEG above the line of sight
    ratio = speed_m_s * math.exp(log_speed) / float(exit_seed(rig, 1.0, 0.0).speed_m_s)
    return Prescribed(distance_m, ratio, hood_deg) if RATIOS[0] <= ratio <= RATIOS[1] else None


def _gain_m(rig: Rig, distance_m: np.ndarray, hood_deg: np.ndarray) -> np.ndarray:
    """By how much a parabola's height at the plane grows per unit of log speed."""
    assert rig.target is not None
    rise_m = rig.target.centre_height_m - rig.launcher.release_height_m
    gain_m: np.ndarray = 2.0 * (distance_m * np.tan(np.radians(hood_deg)) - rise_m)
    return gain_m


def _log_speed(rig: Rig, distance_m: np.ndarray, hood_deg: np.ndarray,
               motor_ratio: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """log(wheels' speed / vacuum's speed to the centre), and whether there is such a speed."""
    assert rig.target is not None
    rise_m = rig.target.centre_height_m - rig.launcher.release_height_m
    speeds = [vacuum_speed_m_s(*pair, rig.world.gravity_m_s2)
              for pair in zip(distance_m.tolist(), [rise_m] * len(distance_m), hood_deg.tolist(), strict=True)]
    vacuum_m_s = np.array([np.nan if speed is None else speed for speed in speeds])
    log_speed = np.log(exit_seed(rig, motor_ratio, 0.0).speed_m_s) - np.log(vacuum_m_s)
    keep = np.isfinite(log_speed)
    return np.where(keep, log_speed, 0.0), keep


def _levers(distance_m: np.ndarray, hood_deg: np.ndarray) -> np.ndarray:
    """1, and distance and elevation up to squares, each about one in size: [n, 6]."""
    d, h = (distance_m - CENTRE_M) / SPAN_M, (hood_deg - CENTRE_DEG) / SPAN_DEG
    return np.column_stack([np.ones_like(d), d, h, d * d, d * h, h * h])
