"""Worlds to discover in, made without a line of the simulator: point masses integrated by SciPy's DOP853.

All numbers SI; frame x toward the target, y left, z up.
"""

from dataclasses import dataclass

import numpy as np

from tests.sim.infer import independent
from truearc.robot.config.rig_spec import Ball, LauncherFacts, Noise, Rig, Target, Wheel
from truearc.sim.data.dataset import Dataset, Shots

FACTS = Rig(ball=Ball(0.14, 0.0889),
    launcher=LauncherFacts(0.75, 594.0, (Wheel("lower", 0.0508, 1.0, 180.0), Wheel("upper", 0.0349, 0.5625, 0.0))),
    target=Target(2.44), noise=Noise(0.03, 0.2, 0.5, 0.005))


@dataclass(frozen=True)
class World:
    """The truth."""

    cd: float = 0.5
    cl: float = 0.06
    speed_scatter: float = 0.01
    angle_scatter_deg: float = 0.3
    aim_spread: float = 0.015         # of launch speed, from shot to shot, known to all
    speed_by_battery: float = 0.0     # relative change of launch speed per volt away from 11.8
    measured: bool = False            # heights at the plane are given
    speed_drift: float = 0.0          # relative change of launch speed from first to last shot


def make_outcomes(world: World, shots: int, seed: int, signed: bool = True) -> Dataset:
    """Shots of the paper's rig at its target: distance, hood, motor ratio, outcome and (signed) the side.

    Aimed by a search with the true physics, then spread, so that all outcomes occur.
    """
    rng = np.random.default_rng(seed)
    distance, hood = rng.uniform(2.5, 6.0, shots), rng.uniform(45.0, 60.0, shots)
    t_s = np.cumsum(rng.uniform(5.0, 20.0, shots))
    ratio = _aim(world, distance, hood) * (1.0 + rng.normal(0.0, world.aim_spread, shots))
    battery = rng.uniform(11.0, 12.6, shots)
    drift = 1.0 + world.speed_drift * (t_s / t_s[-1] - 0.5) + world.speed_by_battery * (battery - 11.8)
    height = plane_heights(world, ratio, hood + rng.normal(0.0, world.angle_scatter_deg, shots), distance,
                           drift * (1.0 + rng.normal(0.0, world.speed_scatter, shots)))
    distance = distance + rng.normal(0.0, FACTS.noise.distance_m, shots)
    off = height - FACTS.target.centre_height_m
    outcome = np.where(np.abs(off) <= 0.07, "three", np.where(np.abs(off) <= 0.35, "two", "miss"))
    side = np.where((outcome == "three") | (not signed), "", np.where(off < 0.0, "low", "high"))
    numbers = {"distance_m": distance, "hood_deg": hood, "motor_ratio": ratio, "t_s": t_s}
    if world.measured:
        numbers |= {"battery_v": battery, "miss_height_m": off + rng.normal(0.0, 0.02, shots)}
    texts = {"outcome": tuple(outcome.tolist()), "side": tuple(side.tolist())}
    return Dataset("world", FACTS, Shots(tuple(f"s{k}" for k in range(shots)), numbers, texts))


def plane_heights(world: World, ratio: np.ndarray, hood_deg: np.ndarray, distance_m: np.ndarray,
                  speed_factor: np.ndarray) -> np.ndarray:
    """Heights at which the paper's rig (its Eq. 11 and 12) passes the planes."""
    lower, upper = ratio * 594.0 * 0.0508, ratio * 594.0 * 0.5625 * 0.0349
    speed, spin = speed_factor * (lower + upper) / 2.0, (lower - upper) / (2.0 * np.pi * 0.0889)
    return heights_at(distance_m, speed, np.radians(hood_deg), world.cd, world.cl, spin)


def heights_at(distance_m: np.ndarray, speed: np.ndarray, angle: np.ndarray, cd: float, cl: float,
               spin: np.ndarray) -> np.ndarray:
    """Heights at the planes, through the floor if need be."""
    truth = independent.Truth(cd=cd, cl=cl)
    return independent.heights(distance_m, speed, angle, spin, truth)


def _aim(world: World, distance_m: np.ndarray, hood_deg: np.ndarray) -> np.ndarray:
    low, high = np.full(len(hood_deg), 0.2), np.full(len(hood_deg), 1.0)
    for _ in range(14):
        middle = 0.5 * (low + high)
        under = plane_heights(world, middle, hood_deg, distance_m, np.ones(len(hood_deg))) < 2.44
        low, high = np.where(under, middle, low), np.where(under, high, middle)
    return 0.5 * (low + high)
