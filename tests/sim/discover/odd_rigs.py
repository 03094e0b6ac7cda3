"""Rigs unlike the paper's, their shots flown by SciPy's DOP853: three wheels, and balls let fall.

All numbers SI; frame x toward the target, y left, z up.
"""

import numpy as np
from scipy.integrate import solve_ivp

from tests.sim.discover.worlds import heights_at
from truearc.robot.config.rig_spec import Ball, LauncherFacts, Noise, Rig, Target, Wheel
from truearc.sim.data.dataset import Dataset, Shots, Tracks

MASS, RADIUS = 0.14, 0.0889
RELEASE, CENTRE = 0.75, 2.44
WHEELS = (Wheel("left", 0.05, 1.0, 300.0), Wheel("right", 0.05, 1.0, 60.0), Wheel("bottom", 0.05, 1.0, 180.0))
THREE = Rig(ball=Ball(MASS, RADIUS), launcher=LauncherFacts(RELEASE, None, WHEELS), target=Target(CENTRE),
              noise=Noise(0.03, 0.2, 0.5, 0.005))


def make_three_wheels(sag: float, shots: int, seed: int) -> Dataset:
    """Three evenly spaced wheels, the upper two alike; heights at the plane are measured.

    sag: how much the speed follows the battery, as shares of each.
    """
    rng = np.random.default_rng(seed)
    distance, hood = rng.uniform(2.5, 5.0, shots), rng.uniform(45.0, 60.0, shots)
    battery = rng.uniform(11.2, 12.4, shots)
    bottom = rng.uniform(1.0, 1.6, shots)
    # no slip on three wheels: the speed is the mean surface speed, and backspin what the bottom one is ahead
    upper = 9.5 * np.sqrt(distance / 4.0) / ((2.0 + bottom) / 3.0)
    speed = (2.0 * upper + bottom * upper) / 3.0
    spin_rad_s = (bottom * upper - upper) / 1.5 / RADIUS
    luck = (1.0 + rng.normal(0.0, 0.012, shots)) * (1.0 + sag * (battery / np.median(battery) - 1.0))
    angle = np.radians(hood + rng.normal(0.0, 0.3, shots))
    off = heights_at(distance, speed * luck, angle, 0.5, 0.06, spin_rad_s / (2.0 * np.pi)) - CENTRE
    numbers = {"distance_m": distance + rng.normal(0.0, 0.03, shots), "hood_deg": hood, "battery_v": battery,
               "wheel_left_rad_s": upper / 0.05, "wheel_right_rad_s": upper / 0.05,
               "wheel_bottom_rad_s": bottom * upper / 0.05, "miss_height_m": off + rng.normal(0.0, 0.01, shots)}
    return Dataset("three", THREE, Shots(tuple(f"s{k}" for k in range(shots)), numbers, {}))


def make_drops(shots: int, seed: int, cd: float = 0.5, track_m: float = 0.02) -> Dataset:
    """Balls let fall from 10 m and filmed, with hardly any speed of their own; a rig without wheels and target."""
    rng = np.random.default_rng(seed)
    time_s, drag = np.linspace(0.0, 1.2, 20), 0.5 * cd * 1.2 * np.pi * RADIUS**2 / MASS
    parts = []
    for _ in range(shots):
        start = np.array([0.0, 0.0, 10.0, 1e-4, 0.0, rng.uniform(-1.0, 0.0)])
        flown = solve_ivp(lambda _, s: [*s[3:], *(-drag * np.linalg.norm(s[3:]) * s[3:] - [0.0, 0.0, 9.81])],
                          (0.0, 1.2), start, "DOP853", t_eval=time_s, rtol=1e-9, atol=1e-10)
        parts.append(flown.y[:3].T + rng.normal(0.0, track_m, (len(time_s), 3)))
    tracks = Tracks(np.repeat(np.arange(shots), len(time_s)), np.tile(time_s, shots), *np.concatenate(parts).T)
    facts = Rig(ball=Ball(MASS, RADIUS), noise=Noise(track_m=track_m))
    return Dataset("drops", facts, Shots(tuple(map(str, range(shots))), {}, {}), tracks)
