"""Forecasts against other code's shots: heights, and each part of the standard deviation by Monte Carlo."""

import numpy as np
import pytest

from tests.sim.infer import independent
from tests.sim.infer.independent import Truth
from tests.sim.physics import reference
from tests.sim.physics.rigs import GUPPY
from truearc.sim.data.dataset import Shots
from truearc.sim.infer.belief import Belief, draw, point_belief
from truearc.sim.infer.forecast import forecast

TRUTH = Truth(speed_sd=0.02, elevation_sd_deg=0.5)
EXACT = {"drag": {"cd": TRUTH.cd}, "magnus": {"cl": TRUTH.cl}, "exit_efficiency": {"loss": TRUTH.loss}}
CONFIGURATION = independent.configurations(np.random.default_rng(2), TRUTH, 5)


def _shots(configuration=CONFIGURATION) -> Shots:
    names = ("distance_m", "hood_deg", "motor_ratio")
    return Shots(tuple(map(str, range(len(configuration[0])))), dict(zip(names, configuration, strict=True)), {})


def _clean_height(truth: Truth) -> np.ndarray:
    distance_m, hood_deg, ratio = CONFIGURATION
    speed, spin = reference.exit_of(ratio)
    return independent.heights(distance_m, speed * (1 - truth.loss), np.radians(hood_deg), spin, truth)


def test_heights_and_scatter_are_those_of_many_shots():
    """Launch scatter and sensor noise together; a point belief adds no uncertainty."""
    ahead = forecast(GUPPY, point_belief(EXACT, {"speed": 0.02, "elevation_deg": 0.5}), _shots())
    np.testing.assert_allclose(ahead.height_m, _clean_height(TRUTH), atol=1e-5)
    np.testing.assert_array_equal(ahead.parameter_m, 0.0)
    rng = np.random.default_rng(3)
    for row in range(5):
        columns = [np.full(8000, column[row]) for column in CONFIGURATION]
        fired = independent.fired(rng, TRUTH, *columns)
        assert ahead.sigma_m[row] == pytest.approx(fired.std(), rel=0.05)
    np.testing.assert_allclose(ahead.sigma_m**2, ahead.launch_m**2 + ahead.sensor_m**2, rtol=1e-12)


def test_doubt_about_the_belief_is_that_of_its_draws():
    names = ("drag.cd", "exit_efficiency.loss", "magnus.cl")
    factor = np.array([[0.06, 0, 0], [-0.015, 0.005, 0], [0.0, 0.001, 0.003]])
    belief = Belief(EXACT, {}, names, factor @ factor.T)
    ahead = forecast(GUPPY, belief, _shots())
    heights = [_clean_height(Truth(one.coefficients["drag"]["cd"], one.coefficients["magnus"]["cl"],
                                   one.coefficients["exit_efficiency"]["loss"]))
               for one in draw(belief, 400, np.random.default_rng(5))]
    np.testing.assert_allclose(ahead.parameter_m, np.std(heights, axis=0), rtol=0.15)


def test_the_slopes_are_those_of_dop853():
    ahead = forecast(GUPPY, point_belief(EXACT), _shots())
    distance_m, hood_deg, ratio = CONFIGURATION
    speed, spin = reference.exit_of(ratio)

    def height(log_speed=0.0, elevation=0.0, turns=0.0, further=0.0):
        return independent.heights(distance_m + further, speed * 0.75 * np.exp(log_speed),
                                   np.radians(hood_deg) + elevation, spin + turns, TRUTH)

    for column, name in enumerate(("log_speed", "elevation", "turns", "further")):
        slope = (height(**{name: 1e-3}) - height(**{name: -1e-3})) / 2e-3
        np.testing.assert_allclose(ahead.by_launch[:, column], slope, rtol=2e-3, atol=1e-4)


def test_a_ball_that_turns_back_has_no_height():
    lift = {"drag": {"cd": 0.5}, "magnus": {"cl": 3.0}}
    ahead = forecast(GUPPY, point_belief(lift), _shots((np.array([6.0]), np.array([50.0]), np.array([0.6]))))
    assert np.isnan([ahead.height_m[0], ahead.sigma_m[0]]).all()


def test_a_measured_exit_has_no_scatter_left():
    shots = _shots()
    speed = reference.exit_of(CONFIGURATION[2])[0] * 0.75
    measured = Shots(shots.shot_id, {**shots.numbers, "exit_speed_m_s": speed, "exit_deg": CONFIGURATION[1]}, {})
    ahead = forecast(GUPPY, point_belief(EXACT, {"speed": 0.02, "elevation_deg": 0.5}), measured)
    np.testing.assert_array_equal(ahead.launch_m, 0.0)
    np.testing.assert_allclose(ahead.height_m, _clean_height(TRUTH), atol=1e-5)     # and no loss on top of it
