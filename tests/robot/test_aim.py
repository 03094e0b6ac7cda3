"""The collection plan and its ballistics."""

import math
from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from truearc import robot
from truearc.robot.aim import plan, step_walk, vacuum_speed_m_s, walked
from truearc.robot.config.schema import load_config
from truearc.robot.types import Shot

CONFIG = load_config(Path(robot.__file__).parent / "launcher.toml")


@given(st.floats(1.0, 12.0), st.floats(0.5, 2.5), st.floats(20.0, 74.0))
def test_the_vacuum_speed_hits_the_target(distance_m, rise_m, elevation_deg):
    speed = vacuum_speed_m_s(distance_m, rise_m, elevation_deg, 9.81)
    angle = math.radians(elevation_deg)
    if speed is None:
        assert distance_m * math.tan(angle) <= rise_m
        return
    flight = distance_m / (speed * math.cos(angle))
    assert math.isclose(speed * math.sin(angle) * flight - 9.81 * flight**2 / 2, rise_m, abs_tol=1e-6)


def test_the_plan_fills_hood_range_and_speeds_evenly_and_repeats_what_it_should():
    shares, trims = np.array([plan(trial, CONFIG.collect) for trial in range(300)]).T
    for third in range(3):
        assert 90 <= np.sum((shares >= third / 3) & (shares < (third + 1) / 3)) <= 110
    assert np.max(np.abs(trims)) <= CONFIG.collect.spread
    assert abs(np.mean(trims)) < 0.01


def shot(distance_m, trial, hood_deg=45.0):
    return Shot(trial, 0, "c", distance_m, 0.02, hood_deg, 0.5, 300.0, 12.0, None, None, None)


def test_marks_walk_the_speed_but_for_what_the_trim_explains():
    collect = CONFIG.collect
    small = next(trial for trial in range(100) if abs(plan(trial, collect)[1]) < 0.1 * collect.spread)
    walk = (0.0, 0.0, 0.0)
    for _ in range(5):
        walk = step_walk(walk, -1, shot(8.0, small), CONFIG)
    assert walked(walk, 8.0, 45.0) > walked(walk, 5.0, 45.0) > 0.0
    assert step_walk(walk, 0, shot(8.0, small), CONFIG) == walk
    collect = CONFIG.collect
    fast = next(trial for trial in range(100) if plan(trial, collect)[1] > 0.5 * collect.spread)
    assert step_walk((0.0, 0.0, 0.0), 1, shot(5.0, fast), CONFIG) == (0.0, 0.0, 0.0)
    assert step_walk((0.0, 0.0, 0.0), -1, shot(5.0, fast), CONFIG)[0] > 0.0
