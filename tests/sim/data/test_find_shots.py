"""Balls that slow wheels down, by a closed form of a wheel under a controller, are found; nothing else is."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from truearc.sim.data.log import Series, find_dips, find_shots

LEAST = 0.01


def wheel(shots_s: list[float], rate_hz: float, depth: float, speed: float = 400.0, noise: float = 0.0,
          recovery_s: float = 0.12, seed: int = 0, end_s: float = 60.0) -> tuple[Series, Series]:
    """(speed, set point): up from rest by 2 s; a ball takes a share within 0.04 s, which comes back exponentially."""
    t_s = np.arange(0.0, end_s, 1.0 / rate_hz)
    value = speed * np.clip(t_s / 2.0, 0.0, 1.0)
    for shot_s in shots_s:
        since = t_s - shot_s
        fall = np.clip(since / 0.04, 0.0, 1.0) * np.exp(-np.clip(since - 0.04, 0.0, None) / recovery_s)
        value = value - depth * speed * fall
    value = value + np.random.default_rng(seed).normal(0.0, noise, len(t_s))
    return Series("v", t_s, value), Series("set", np.array([0.0, 0.5]), np.array([0.0, speed]))


@settings(max_examples=40)
@given(waits=st.lists(st.floats(0.35, 4.0), min_size=1, max_size=12),
       rate_hz=st.sampled_from([20.0, 50.0, 100.0, 200.0]), depth=st.floats(0.03, 0.2),
       seed=st.integers(0, 100), told=st.booleans())
def test_every_ball_is_found_once_and_just_before_it_touches(waits: list[float], rate_hz: float, depth: float,
                                                             seed: int, told: bool) -> None:
    shots_s = list(4.0 + np.cumsum(waits))
    speed, wanted = wheel(shots_s, rate_hz, depth, noise=0.3, seed=seed)
    found = find_dips(speed, wanted if told else None, LEAST)
    assert len(found) == len(shots_s)
    assert (np.abs(found - shots_s) <= 2.5 / rate_hz + 0.01).all()


def test_a_stream_of_balls_is_counted_before_the_wheel_has_recovered() -> None:
    shots_s = list(5.0 + 0.12 * np.arange(8))
    speed, wanted = wheel(shots_s, 200.0, 0.05, recovery_s=0.05)
    assert len(find_dips(speed, wanted, LEAST)) == 8


@pytest.mark.parametrize("told", [True, False])
def test_letting_a_wheel_run_down_and_setting_it_lower_is_no_ball(told: bool) -> None:
    t_s = np.arange(0.0, 20.0, 0.02)
    value = np.interp(t_s, [0, 2, 6, 8, 12, 20], [0, 400, 400, 280, 280, 0])
    wanted = Series("set", np.array([0.0, 0.1, 6.0, 12.0]), np.array([0.0, 400.0, 280.0, 0.0]))
    assert len(find_dips(Series("v", t_s, value), wanted if told else None, LEAST)) == 0


def test_a_wheel_that_runs_below_its_set_point_and_one_that_turns_backwards_show_balls() -> None:
    speed, wanted = wheel([5.0, 8.0], 100.0, 0.06)
    low = Series("v", speed.t_s, 0.9 * np.asarray(speed.values))
    assert len(find_dips(low, wanted, LEAST)) == 2
    back = Series("v", speed.t_s, -np.asarray(speed.values))
    assert len(find_dips(back, Series("set", wanted.t_s, -np.asarray(wanted.values)), LEAST)) == 2


def feeder(runs: list[tuple[float, float]]) -> Series:
    edges = sorted([(start, 1.0) for start, _ in runs] + [(end, 0.0) for _, end in runs])
    return Series("feed", np.array([0.0, *(at for at, _ in edges)]), np.array([0.0, *(value for _, value in edges)]))


def test_shots_are_checked_against_the_feeder() -> None:
    speed, wanted = wheel([5.0, 8.0, 12.0], 100.0, 0.06)
    found = find_shots(speed, wanted, feeder([(4.9, 5.2), (7.9, 8.1), (10.0, 10.3)]), 0.5, LEAST)
    assert found.t_s == pytest.approx([4.9, 7.9])                  # what was before anything moved
    assert any("t = 10.00 s: fed, but" in line for line in found.odd)
    assert any("t = 11.99 s: the wheels slow down" in line or "t = 12.00 s: the wheels" in line for line in found.odd)


def test_one_run_of_the_feeder_may_carry_several_balls() -> None:
    speed, wanted = wheel([5.0, 5.5, 6.0], 100.0, 0.06)
    found = find_shots(speed, wanted, feeder([(4.9, 6.1)]), 0.5, LEAST)
    assert found.t_s == pytest.approx([4.9, 5.5, 6.0], abs=0.03) and not found.odd
