"""Tracks whose floor is off level to the side, and a crosswind: flights of plain NumPy, one session each."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import truearc as ta
from tests.sim.few_terms import few_terms

RIG = Path(__file__).parents[3] / "examples" / "tracks" / "rig.toml"
MASS_KG, RADIUS_M, AIR_KG_M3, CD, CL = 0.14, 0.0889, 1.2, 0.5, 0.10
STEP_S, FRAME, NOISE_M = 5e-4, 100, 0.005


def fly(speed_m_s: float, elevation: float, azimuth: float, spin_rev_s: float, wind_m_s: float) -> np.ndarray:
    """Positions [n, 3] in m at each frame, by gravity, drag, lift of backspin, and wind to the left."""
    across = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
    ahead = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    place = np.array([0.0, 0.0, 0.75])
    velocity = speed_m_s * (np.cos(elevation) * ahead + np.sin(elevation) * np.array([0.0, 0.0, 1.0]))
    drag = 0.5 * CD * AIR_KG_M3 * np.pi * RADIUS_M**2 / MASS_KG
    lift = CL * (4 / 3) * 4 * np.pi**2 * RADIUS_M**3 * spin_rev_s * AIR_KG_M3 / MASS_KG
    seen = []
    for step in range(12_000):
        if step % FRAME == 0:
            seen.append(place)
        through = velocity - np.array([0.0, wind_m_s, 0.0])
        pull = np.array([0.0, 0.0, -9.81]) - drag * np.linalg.norm(through) * through + lift * np.cross(across, through)
        velocity, place = velocity + STEP_S * pull, place + STEP_S * velocity
        if place[2] < 1.0 and velocity[2] < 0.0:
            break
    return np.array(seen)


def film(seed: int, roll_deg: float, wind_m_s: float) -> ta.Dataset:
    """16 flights through a camera that sees what lies left too high by roll_deg."""
    random = np.random.default_rng(seed)
    shots, rows, roll = [], [], np.radians(roll_deg)
    for shot in range(16):
        spin = random.uniform(0.0, 6.0)
        x, y, z = fly(random.uniform(8.0, 11.0), np.radians(random.uniform(40.0, 60.0)),
                      np.radians(random.uniform(-2.0, 2.0)), spin, wind_m_s).T
        y, z = y * np.cos(roll) - z * np.sin(roll), z * np.cos(roll) + y * np.sin(roll)
        shots.append({"shot_id": str(shot), "exit_spin_rev_s": spin})
        rows += [{"shot_id": str(shot), "t_s": frame * FRAME * STEP_S, "x_m": a, "y_m": b, "z_m": c}
                 for frame, (a, b, c) in enumerate(np.stack([x, y, z], 1) + random.normal(0.0, NOISE_M, (len(x), 3)))]
    return ta.dataset(pd.DataFrame(shots), rig=RIG, tracks=pd.DataFrame(rows))


@pytest.mark.slow
@pytest.mark.parametrize(("roll_deg", "wind_m_s", "term", "other"), [
    (2.0, 0.0, "track_roll", "wind_y"), (0.0, 1.0, "wind_y", "track_roll")])
def test_a_floor_off_level_is_told_from_a_crosswind_in_one_session(roll_deg: float, wind_m_s: float, term: str,
                                                                  other: str) -> None:
    found = ta.discover(film(1, roll_deg, wind_m_s), believe=["gravity", "drag", "magnus"], seed=0,
                        terms=few_terms("wind_x", "wind_y", "drag_reynolds", "spin_decay"))
    assert found.verdict == "named" and found.best is not None and found.best.term == term
    low, high = found.best.interval90
    assert low - 0.05 < (roll_deg or wind_m_s) < high + 0.05
    assert all(one.probability < 0.05 for one in found.effects if one.term == other)
    fit = found.record.fit
    assert fit.side_rmse_after_m < 0.5 * fit.side_rmse_before_m
    assert "how far to the side tracks end" in found.sentence and "where tracks end" not in found.sentence
