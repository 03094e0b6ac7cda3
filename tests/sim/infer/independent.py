"""Shots simulated without the code under test: the paper's equations in angles over x, SciPy's DOP853, own scatter."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from tests.sim.physics import reference as rig
from tests.sim.physics.rigs import GUPPY
from truearc.sim.data.dataset import Dataset, Shots, Tracks

CENTRE_M, INNER_M, OUTER_M = 2.44, 0.07, 0.35
DISTANCE_SD_M, HOOD_SD_DEG, WHEEL_SD_RAD_S = 0.05, 0.2, 0.5       # rig.toml's defaults
AREA_M2 = math.pi * rig.RADIUS_M**2


@dataclass(frozen=True)
class Truth:
    """Truth behind the shots. `speed_sd` of the log of the exit speed."""

    cd: float = 0.5
    cl: float = 0.06
    loss: float = 0.25
    speed_sd: float = 0.015
    elevation_sd_deg: float = 0.4


def rates(velocity: np.ndarray, spin_rev_s: np.ndarray, truth: Truth) -> np.ndarray:
    """Eq. 4 and 5: (dvx/dt, dvy/dt) [2, n]."""
    vx, vy = velocity
    speed, angle = np.hypot(vx, vy), np.arctan2(vy, vx)
    lift = truth.cl * 4 / 3 * (4 * math.pi**2 * rig.RADIUS_M**3 * spin_rev_s * rig.DENSITY_KG_M3 * speed) / rig.MASS_KG
    drag = truth.cd / 2 * AREA_M2 * speed**2 * rig.DENSITY_KG_M3 / rig.MASS_KG
    return np.array([-(lift * np.sin(angle) + drag * np.cos(angle)),
                     lift * np.cos(angle) - drag * np.sin(angle) - rig.GRAVITY_M_S2])


def heights(distance_m, speed_m_s, elevation_rad, spin_rev_s, truth: Truth) -> np.ndarray:
    """Height at x = distance [n], all shots at once, each over its own distance; wild where a ball would turn back."""
    n = len(distance_m)

    def slope(_, state):
        _, vx, vy = state.reshape(3, n)
        vx = np.maximum(vx, 0.2)
        return (np.array([vy, *rates(np.array([vx, vy]), spin_rev_s, truth)]) / vx * distance_m).ravel()

    velocity = speed_m_s * np.array([np.cos(elevation_rad), np.sin(elevation_rad)])
    start = np.concatenate([np.full(n, rig.RELEASE_M), *velocity])
    done = solve_ivp(slope, (0.0, 1.0), start, method="DOP853", rtol=1e-8, atol=1e-9)
    return done.y[:n, -1]


def fired(rng: np.random.Generator, truth: Truth, distance_m, hood_deg, ratio) -> np.ndarray:
    """Height above the centre [n] of real shots at configurations as measured."""
    n = len(distance_m)
    lower = ratio * rig.FREE_SPEED_RAD_S + rng.normal(0.0, WHEEL_SD_RAD_S, n)
    upper = ratio * rig.FREE_SPEED_RAD_S * rig.UPPER_GEAR + rng.normal(0.0, WHEEL_SD_RAD_S, n)
    surfaces = upper * rig.UPPER_RADIUS_M, lower * rig.LOWER_RADIUS_M
    speed = (surfaces[0] + surfaces[1]) / 2 * (1.0 - truth.loss) * np.exp(rng.normal(0.0, truth.speed_sd, n))
    spin = (surfaces[1] - surfaces[0]) / (2 * math.pi * rig.RADIUS_M)
    hood = hood_deg + rng.normal(0.0, HOOD_SD_DEG, n) + rng.normal(0.0, truth.elevation_sd_deg, n)
    return heights(distance_m + rng.normal(0.0, DISTANCE_SD_M, n), speed, np.radians(hood), spin, truth) - CENTRE_M


def configurations(rng: np.random.Generator, truth: Truth, n: int, spread: float = 0.03):
    """(distance, hood, ratio) [n]: somewhere in the field, aimed at the centre within `spread` of the speed."""
    distance_m, hood_deg = rng.uniform(2.5, 6.5, n), rng.uniform(32.0, 58.0, n)
    low, high = np.full(n, 0.3), np.full(n, 1.2)
    for _ in range(16):
        ratio = 0.5 * (low + high)
        speed, spin = rig.exit_of(ratio)
        over = heights(distance_m, speed * (1.0 - truth.loss), np.radians(hood_deg), spin, truth) > CENTRE_M
        low, high = np.where(over, low, ratio), np.where(over, ratio, high)
    return distance_m, hood_deg, low * np.exp(rng.normal(0.0, spread, n))


def outcomes(deviation_m: np.ndarray) -> tuple[str, ...]:
    off = np.abs(deviation_m)
    return tuple(np.where(off <= INNER_M, "three", np.where(off <= OUTER_M, "two", "miss")).tolist())


def sides(deviation_m: np.ndarray) -> tuple[str, ...]:
    """High or low of all but threes."""
    words = np.where(np.abs(deviation_m) <= INNER_M, "", np.where(deviation_m > 0.0, "high", "low"))
    return tuple(words.tolist())


def make_dataset(seed: int, n: int, truth: Truth = Truth(), side: bool = False, height: bool = False) -> Dataset:
    """Shots with outcomes, sides or measured heights; a ratio stays a ratio (0-1) with any of the truths used here."""
    rng = np.random.default_rng(seed)
    distance_m, hood_deg, ratio = configurations(rng, truth, n)
    deviation_m = fired(rng, truth, distance_m, hood_deg, ratio)
    numbers = {"distance_m": distance_m, "hood_deg": hood_deg, "motor_ratio": ratio}
    texts = {"outcome": outcomes(deviation_m)}
    if side:
        texts["side"] = sides(deviation_m)
    if height:
        numbers["miss_height_m"] = deviation_m + rng.normal(0.0, 0.02, n)
    return Dataset("simulated", GUPPY, Shots(tuple(f"s{row}" for row in range(n)), numbers, texts))


def make_tracks(seed: int, n: int, truth: Truth = Truth(), samples: int = 20, dt_s: float = 1 / 60,
                noise_m: float = 0.012, wheels: bool = True) -> Dataset:
    """Tracked flights sent off a little to the side, seen from some moment after the exit; balls without wheels do not
    spin, and how they were thrown is unknown."""
    rng = np.random.default_rng(seed)
    distance_m, hood_deg, ratio = rng.uniform(2.5, 6.5, n), rng.uniform(32.0, 58.0, n), rng.uniform(0.45, 0.75, n)
    rows = []
    for shot in range(n):
        speed, spin = rig.exit_of(ratio[shot])
        speed *= (1.0 - truth.loss) * math.exp(rng.normal(0.0, truth.speed_sd))
        angle = math.radians(hood_deg[shot] + rng.normal(0.0, math.hypot(truth.elevation_sd_deg, HOOD_SD_DEG)))
        spin = spin if wheels else 0.0
        time_s = rng.uniform(0.02, 0.08) + dt_s * np.arange(samples)
        start = [0.0, rig.RELEASE_M, speed * math.cos(angle), speed * math.sin(angle)]
        flown = solve_ivp(lambda _, s, spin=spin: [s[2], s[3], *rates(s[2:], spin, truth)], (0.0, time_s[-1]), start,
                          method="DOP853", rtol=1e-9, atol=1e-10, t_eval=time_s).y
        heading = rng.normal(0.0, 0.02)
        clean = np.array([flown[0] * math.cos(heading), flown[0] * math.sin(heading), flown[1]])
        rows.append((np.full(samples, shot), time_s - time_s[0], *(clean + rng.normal(0.0, noise_m, clean.shape))))
    columns = [np.concatenate(column) for column in zip(*rows, strict=True)]
    numbers = {"distance_m": distance_m}
    if wheels:
        numbers |= {"hood_deg": hood_deg, "motor_ratio": ratio}
    return Dataset("tracked", GUPPY, Shots(tuple(f"s{row}" for row in range(n)), numbers, {}), Tracks(*columns))
