"""Benchmark of `truearc aim`: expected points of its set points, compared with an exhaustive search.

    python -m benchmarks.aim [--rigs 1000] [--seed 1000]

Launchers, balls and targets are drawn at random, with three distances each. The exhaustive search uses an independent
simulation (drag and gravity, fourth-order Runge-Kutta over time); it tries hood angles in whole degrees, and 61 speeds
around the one that reaches the centre. The benchmark prints by how much the expected points of aim's set points,
computed with that simulation, fall short of the best: quantiles over all distances, and the worst cases. A distance
that aim refuses counts as a loss of all its points; distances where the search finds less than 0.05 points do not
count.
"""

import sys
from typing import NamedTuple

import jax
import numpy as np

import truearc as ta
from benchmarks.options import read_options
from truearc.cli.common import make_progress
from truearc.robot.config.rig_spec import Ball, LauncherFacts, Noise, Rig, Target, Wheel
from truearc.sim.infer.belief import point_belief

AIR_KG_M3, GRAVITY_M_S2, STEP_S, STEPS = 1.2, 9.81, 0.01, 500
LOWEST_M = -5.0                       # below it a ball is not followed: no target is near
FREE_RAD_S = 600.0
TRIMS = np.linspace(-0.06, 0.06, 61)
HOOD_DEG = (25.0, 70.0)
DISTANCES = 3
SCORES = 0.05                         # points; with less by search a distance does not count
QUANTILES = (0.5, 0.9, 0.99, 0.999)


class Case(NamedTuple):
    """A launcher: its rig, drag coefficient, and scatter of log speed and of elevation in degrees."""

    rig: Rig
    cd: float
    scatter: tuple[float, float]
    distances_m: np.ndarray


def make_case(seed: int) -> Case:
    """A random launcher with a target that it can reach."""
    rng = np.random.default_rng([seed, 32])
    radius_m = rng.uniform(0.03, 0.13)
    mass_kg = rng.uniform(60.0, 500.0) * 4.0 / 3.0 * np.pi * radius_m**3
    three_m = rng.uniform(0.05, 0.2)
    wheels = (Wheel("lower", rng.uniform(0.04, 0.08), 1.0, 180.0), Wheel("upper", rng.uniform(0.02, 0.05), 2.0, 0.0))
    rig = Rig(Ball(mass_kg, radius_m), LauncherFacts(rng.uniform(0.3, 1.0), FREE_RAD_S, wheels),
              Target(rng.uniform(1.2, 2.8), three_m, three_m + rng.uniform(0.05, 0.3)),
              noise=Noise(rng.uniform(0.0, 0.1), rng.uniform(0.0, 0.4), rng.uniform(0.0, 2.0)))
    near_m = rng.uniform(1.5, 3.0)
    return Case(rig, rng.uniform(0.2, 0.6), (rng.uniform(0.005, 0.03), rng.uniform(0.1, 1.0)),
                np.linspace(near_m, near_m + rng.uniform(1.0, 4.0), DISTANCES))


def height_at(case: Case, distance_m: np.ndarray, hood_deg: np.ndarray, speed_m_s: np.ndarray) -> np.ndarray:
    """Heights [n] above the floor at a distance; NaN where a ball does not get there."""
    k = AIR_KG_M3 * case.cd * np.pi * case.rig.ball.radius_m**2 / 2.0 / case.rig.ball.mass_kg
    angle = np.radians(hood_deg)
    zero = np.zeros_like(angle)
    state = np.stack([zero, zero + case.rig.launcher.release_height_m, speed_m_s * np.cos(angle),
                      speed_m_s * np.sin(angle)])
    height = np.full_like(angle, np.nan)

    def rate(at: np.ndarray) -> np.ndarray:
        pace = np.hypot(at[2], at[3])
        return np.stack([at[2], at[3], -k * pace * at[2], -k * pace * at[3] - GRAVITY_M_S2])

    for _ in range(STEPS):
        one = rate(state)
        two = rate(state + 0.5 * STEP_S * one)
        three = rate(state + 0.5 * STEP_S * two)
        four = rate(state + STEP_S * three)
        after = state + STEP_S / 6.0 * (one + 2.0 * two + 2.0 * three + four)
        passes = (state[0] < distance_m) & (after[0] >= distance_m)
        if passes.any():
            share = (distance_m - state[0]) / np.maximum(after[0] - state[0], 1e-12)
            height = np.where(passes, state[1] + share * (after[1] - state[1]), height)
        state = after
        if ((state[0] >= distance_m) | (state[1] < LOWEST_M)).all():
            break
    return height


def points_of(case: Case, distance_m: np.ndarray, hood_deg: np.ndarray, speed_m_s: np.ndarray) -> np.ndarray:
    """Expected points [n], with a normally distributed height: slopes by differences of flights."""
    from scipy.stats import norm
    rig, (log_speed, elevation_deg) = case.rig, case.scatter
    wheels = rig.launcher.wheel
    wheel_m_s = rig.noise.wheel_rad_s / len(wheels) * np.sqrt(sum(wheel.radius_m**2 for wheel in wheels))
    target = rig.target
    assert target is not None

    def slope(step: float, index: int) -> np.ndarray:
        ends = []
        for sign in (1.0, -1.0):
            moved = [distance_m, hood_deg, speed_m_s]
            moved[index] = moved[index] + sign * step
            ends.append(height_at(case, *moved))
        return (ends[0] - ends[1]) / (2.0 * step)

    by_distance, by_deg, by_speed = slope(1e-3, 0), slope(1e-2, 1), slope(1e-2, 2)
    sigma_m = np.sqrt((by_speed * np.hypot(log_speed * speed_m_s, wheel_m_s))**2
                      + (by_deg * np.hypot(elevation_deg, rig.noise.hood_deg))**2
                      + (by_distance * rig.noise.distance_m)**2)
    off_m = height_at(case, distance_m, hood_deg, speed_m_s) - target.centre_height_m
    p = [norm.cdf((half - off_m) / sigma_m) - norm.cdf((-half - off_m) / sigma_m)
         for half in (target.two_half_height_m, target.three_half_height_m)]
    return np.nan_to_num(2.0 * p[0] + p[1])


def full_speed(case: Case) -> float:
    """Exit speed in m/s at the motors' free speed: the mean of the wheels' surfaces (Eq. 11 of the paper)."""
    wheels = case.rig.launcher.wheel
    return FREE_RAD_S * sum(wheel.radius_m * wheel.gear for wheel in wheels) / len(wheels)


def best_points(case: Case, distance_m: float) -> float:
    """The most points of all hood angles and speeds."""
    assert case.rig.target is not None
    hood_deg = np.arange(HOOD_DEG[0], HOOD_DEG[1] + 0.5)
    flat = np.full_like(hood_deg, distance_m)
    low, high = np.full_like(hood_deg, 1.0), np.full_like(hood_deg, full_speed(case))
    for _ in range(30):
        middle = 0.5 * (low + high)
        above = height_at(case, flat, hood_deg, middle) > case.rig.target.centre_height_m
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    speed = np.minimum(high[:, None] * (1.0 + TRIMS), full_speed(case)).ravel()
    return float(points_of(case, np.full(speed.size, distance_m), np.repeat(hood_deg, TRIMS.size), speed).max())


def judge(case: Case) -> list[tuple[float, float | None]]:
    """(points by exhaustive search, those of aim's set point: None where it refuses) of every distance that scores."""
    belief = point_belief({"drag": {"cd": case.cd}}, dict(zip(("speed", "elevation_deg"), case.scatter, strict=True)))
    try:
        rows = {row.distance_m: row for row in ta.aim(belief, case.rig, distances_m=case.distances_m,
                                                      hood_deg=HOOD_DEG).rows}
    except ta.InputError:
        rows = {}
    judged = []
    for distance_m in case.distances_m.tolist():
        row, got = rows.get(distance_m), None
        if row is not None:
            got = float(points_of(case, *(np.array([number]) for number in (
                distance_m, row.hood_deg, row.motor_ratio * full_speed(case))))[0])
        judged.append((best_points(case, distance_m), got))
    return [(best, got) for best, got in judged if best >= SCORES]


def shortfalls(judged: list[tuple[float, float | None]]) -> list[float]:
    """Share of the best points that aim's set points lack, a number per distance; 1 where aim refuses."""
    return [1.0 - (got or 0.0) / best for best, got in judged]


def main() -> int:
    args = read_options(__doc__, rigs=1000, seed=(1000, "of the first rig"))
    show, judged = make_progress("aim"), list[tuple[float, float | None]]()
    for number in range(1, args.rigs + 1):
        judged += judge(make_case(args.seed + number - 1))
        jax.clear_caches()                                # each rig is compiled for
        show(number / args.rigs, f"{number} rigs")
    print(f"{args.rigs} rigs, {len(judged)} distances where the search scores; "
          f"aim refused {sum(got is None for _, got in judged)} of them")
    if judged:
        short = np.array(shortfalls(judged))
        told = ", ".join(f"{q:.1%} {np.quantile(short, q):.3%}" for q in QUANTILES)
        print(f"points below the best, quantiles: {told}, worst {short.max():.3%}; over 1 %: {(short > 0.01).sum()}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
