"""What terms may know of a shot, from columns and traces, against numbers worked out by hand."""

import numpy as np
import pytest

from tests.sim.physics.rigs import GUPPY
from truearc.sim.data.dataset import Circumstances, Dataset, Shots, Traces, circumstances_of, gather_circumstances

NAN = np.nan


def _dataset(texts=None, traces=None, **numbers) -> Dataset:
    columns = {name: np.asarray(column, float) for name, column in numbers.items()}
    count = max([len(column) for column in columns.values()] + [len(text) for text in (texts or {}).values()])
    shots = Shots(tuple(f"s{row}" for row in range(count)), columns, texts or {})
    return Dataset("made", GUPPY, shots, traces=traces)


def known(dataset: Dataset) -> set[str]:
    """Fields that the data really have: said of at least two shots, and not of all alike."""
    return {name for name, one in gather_circumstances(dataset).items()
            if one.said.sum() > 1 and np.ptp(one.value[one.said]) > 0.0}


def test_data_that_say_nothing_are_ordinary():
    dataset = _dataset(motor_ratio=[0.5, 0.6, 0.7])
    found = circumstances_of(dataset)
    for name, ordinary in Circumstances()._asdict().items():
        np.testing.assert_array_equal(getattr(found, name), np.full(3, ordinary), err_msg=name)
    assert known(dataset) == set()                # the order of the rows says nothing


def test_battery_against_its_median():
    dataset = _dataset(battery_v=[12.0, NAN, 11.4, 12.6])
    np.testing.assert_allclose(circumstances_of(dataset).battery, (0.0, 0.0, -0.05, 0.05))
    assert "battery" in known(dataset)
    assert "battery" not in known(_dataset(battery_v=[12.0, 12.0]))


def test_waits_are_within_a_session():
    texts = {"session": ("a", "a", "b", "b", "b")}
    dataset = _dataset(texts, t_s=[10.0, 13.0, 0.0, 2.5, 2.0])
    np.testing.assert_allclose(circumstances_of(dataset).since_last_shot_s, (1e9, 3.0, 1e9, 0.5, 2.0))
    own = _dataset(texts, t_s=[10.0, 13.0, 0.0, 2.5, 2.0], since_last_shot_s=[4.0, NAN, NAN, 0.7, NAN])
    np.testing.assert_allclose(circumstances_of(own).since_last_shot_s, (4.0, 3.0, 1e9, 0.7, 2.0))


def test_age_by_time_and_by_ball():
    sessions = {"session": ("a", "a", "a", "b", "b")}
    by_time = circumstances_of(_dataset(sessions, t_s=[0.0, 1.0, 10.0, 50.0, 40.0]))
    np.testing.assert_allclose(by_time.age, (0.0, 0.1, 1.0, 1.0, 0.0))
    np.testing.assert_array_equal(circumstances_of(_dataset(sessions, t_s=[0.0, NAN, 10.0, 50.0, 40.0])).age, 0.0)
    balls = {"session": ("a", "a", "a", "b", "b"), "ball_id": ("x", "y", "x", "x", "y")}
    np.testing.assert_allclose(circumstances_of(_dataset(balls, t_s=[0.0, 1.0, 2.0, 0.0, 1.0])).age,
                               (0.0, 0.0, 0.5, 1.0, 0.5))
    assert "age" not in known(_dataset(balls, motor_ratio=[0.5] * 5))


def test_density_by_the_ideal_gas():
    both = circumstances_of(_dataset(pressure_pa=[101325.0, 99000.0, 101325.0], temperature_c=[20.0, 20.0, 30.0]))
    gas = np.array([101325 / 293.15, 99000 / 293.15, 101325 / 303.15])
    np.testing.assert_allclose(both.density, gas / np.median(gas) - 1.0)
    warmer = circumstances_of(_dataset(temperature_c=[20.0, 30.0, 25.0]))
    np.testing.assert_allclose(warmer.density, 298.15 / np.array([293.15, 303.15, 298.15]) - 1.0)
    assert warmer.density[1] - warmer.density[0] == pytest.approx(-0.034, abs=1e-3)     # 3.4 % for 10 K


def test_the_hood_comes_from_below_or_above():
    texts = {"session": ("a", "a", "a", "a", "b")}
    dataset = _dataset(texts, hood_deg=[40.0, 45.0, 45.0, 30.0, 50.0], t_s=[0.0, 1.0, 2.0, 3.0, 4.0])
    np.testing.assert_allclose(circumstances_of(dataset).hood_change, (0.0, 1.0, 0.0, -1.0, 0.0))
    later = _dataset(texts, hood_deg=[40.0, 45.0, 45.0, 30.0, 50.0], t_s=[4.0, 3.0, 2.0, 1.0, 0.0])
    np.testing.assert_allclose(circumstances_of(later).hood_change, (-1.0, 0.0, 1.0, 0.0, 0.0))
    assert "hood_change" not in known(_dataset(texts, hood_deg=[40.0, 45.0, 45.0, 30.0, 50.0]))


def test_the_robots_speed():
    dataset = _dataset(robot_speed_m_s=[0.0, 1.5, NAN])
    np.testing.assert_allclose(circumstances_of(dataset).closing_speed_m_s, (0.0, 1.5, 0.0))
    assert "closing_speed_m_s" in known(dataset)


def _traces(*rows) -> Traces:
    shot, t_s, signal, value = zip(*rows, strict=True)
    return Traces(np.array(shot), np.array(t_s), tuple(signal), np.array(value))


def test_the_dip_of_the_wheels_by_its_mean():
    """Shot 0: 10 % and 20 % on the two wheels; shot 1: 5 % on the one that was recorded; shot 2: nothing."""
    low, up = "wheel_lower_rad_s", "wheel_upper_rad_s"
    traces = _traces((0, -0.5, low, 500.0), (0, 0.0, low, 400.0), (0, 0.05, low, 360.0), (0, 0.2, low, 390.0),
        (1, 0.04, low, 285.0), (1, 0.0, low, 300.0), (1, 0.0, "battery_v", 12.0), (1, 0.1, "battery_v", 9.0),
        (0, 0.0, up, 200.0), (0, 0.1, up, 160.0), (2, -0.1, up, 300.0), (2, 0.0, up, 300.0))
    dataset = _dataset(motor_ratio=[0.5, 0.5, 0.5], traces=traces)
    np.testing.assert_allclose(circumstances_of(dataset).droop, (0.15 / 0.1, 0.05 / 0.1, 1.0))
    assert known(dataset) == {"droop"}
    noise = _dataset(motor_ratio=[0.5, 0.5], traces=_traces((0, 0.0, "battery_v", 12.0), (0, 0.1, "battery_v", 11.0)))
    np.testing.assert_array_equal(circumstances_of(noise).droop, 1.0)
