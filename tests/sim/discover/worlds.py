"""Worlds to discover in, made without a line of the simulator: point masses integrated by SciPy's DOP853.

All numbers SI; frame x toward the target, y left, z up.
"""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from truearc.robot.config.rig_spec import Ball, LauncherFacts, Noise, Rig, Target, Wheel
from truearc.sim.data.dataset import Dataset, Shots

GRAVITY = 9.81
FACTS = Rig(
    ball=Ball(0.14, 0.0889),
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
    """Heights at the planes, through the floor if need be: one integration, over the share of the distance covered."""
    none = np.zeros(len(speed))

    def per_share(share: float, flat: np.ndarray) -> np.ndarray:
        state = flat.reshape(6, -1).copy()
        state[3] = np.maximum(state[3], 0.2)              # nearly turned back: it ends far below
        return (_rate(share, state, cd, cl, spin, 0.0, 0.0) * distance_m / state[3]).ravel()

    start = np.stack([none, none, none + 0.75, speed * np.cos(angle), none, speed * np.sin(angle)])
    return solve_ivp(per_share, (0.0, 1.0), start.ravel(), "DOP853", rtol=1e-8, atol=1e-8).y[:, -1].reshape(6, -1)[2]


def _aim(world: World, distance_m: np.ndarray, hood_deg: np.ndarray) -> np.ndarray:
    low, high = np.full(len(hood_deg), 0.2), np.full(len(hood_deg), 1.0)
    for _ in range(14):
        middle = 0.5 * (low + high)
        under = plane_heights(world, middle, hood_deg, distance_m, np.ones(len(hood_deg))) < 2.44
        low, high = np.where(under, middle, low), np.where(under, high, middle)
    return 0.5 * (low + high)


def fly(start: np.ndarray, time_s: np.ndarray, forces: tuple[float, ...]) -> np.ndarray:
    flown = solve_ivp(_rate, (0.0, time_s[-1]), start, "DOP853", t_eval=time_s, rtol=1e-9, atol=1e-10,
                      args=forces)
    return flown.y[:3].T


def _rate(t: float, state: np.ndarray, cd: float, cl: float, spin: np.ndarray | float, wind: float,
          lift: float) -> np.ndarray:
    """Gravity, quadratic drag on the velocity through the air, the paper's lift for backspin, and a push upward."""
    vx, vy, vz = state[3:]
    air_y = vy - wind
    speed = np.sqrt(vx * vx + air_y * air_y + vz * vz)
    radius, mass, density = 0.0889, 0.14, 1.2
    drag = cd * 0.5 * density * np.pi * radius**2 / mass * speed
    turn = cl * 4.0 / 3.0 * 4.0 * np.pi**2 * radius**3 * density / mass * spin
    flat = np.hypot(vx, vz)
    return np.array([vx, vy, vz, -drag * vx - turn * vz - lift * vz / flat, -drag * air_y,
                     -drag * vz + turn * vx + lift * vx / flat - GRAVITY])
