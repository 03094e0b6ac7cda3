"""Intervals where tracks contradict each other: flights that differ by more than their noise, flown by DOP853."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import truearc as ta
from truearc.robot.config.rig_spec import Air, Ball, Believe, LauncherFacts, Noise, Rig, Tracker
from truearc.sim.data.dataset import Dataset, Shots, Tracks

MASS, RADIUS, AIR, NOISE_M, CD, SPREAD = 0.14, 0.0889, 1.2, 0.002, 0.5, 0.1
FRAMES_S = np.linspace(0.0, 0.6, 31)


def flights(seed: int, count: int = 16) -> Dataset:
    """Each with a drag coefficient of its own, which the simulation has one of."""
    rng = np.random.default_rng(seed)
    places = []
    for cd, speed, rad in zip(rng.normal(CD, SPREAD, count), rng.uniform(7.0, 10.0, count),
                              np.radians(rng.uniform(35.0, 60.0, count)), strict=True):
        drag = 0.5 * cd * np.pi * RADIUS**2 * AIR / MASS

        def rate(_: float, y: np.ndarray, drag: float = drag) -> np.ndarray:
            return np.concatenate([y[3:], [0.0, 0.0, -9.81] - drag * np.linalg.norm(y[3:]) * y[3:]])

        start = [0.0, 0.0, 1.0, speed * np.cos(rad), 0.0, speed * np.sin(rad)]
        places.append(solve_ivp(rate, (0.0, 0.6), start, "DOP853", t_eval=FRAMES_S, rtol=1e-9, atol=1e-11).y[:3].T)
    spot = np.concatenate(places) + rng.normal(0.0, NOISE_M, (count * 31, 3))
    rig = Rig(Ball(MASS, RADIUS), LauncherFacts(release_height_m=1.0), air=Air(AIR), noise=Noise(track_m=NOISE_M),
              tracker=Tracker(calibrated=True), believe=Believe(()))
    return Dataset("mixed", rig, Shots(tuple(f"s{k}" for k in range(count)), {}, {}),
                   Tracks(np.repeat(np.arange(count), 31), np.tile(FRAMES_S, count), *spot.T))


@pytest.mark.slow
def test_an_interval_is_as_wide_as_flights_differ() -> None:
    """A coefficient known to 0.001 by the noise is known to 0.1 / sqrt(16) by the flights: 90 % are +- 0.041."""
    widths, held = [], []
    for seed in range(4):
        cd, = (one for one in ta.fit(flights(seed), ["gravity", "drag"]).intervals if one.name == "drag.cd")
        assert cd.low90 < cd.value < cd.high90
        widths.append(cd.high90 - cd.low90)
        held.append(cd.low90 < CD < cd.high90)
    assert 0.05 < np.mean(widths) < 0.12 and sum(held) >= 3
