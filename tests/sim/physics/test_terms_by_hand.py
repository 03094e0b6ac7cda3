"""What single terms say, worked out by hand."""

import numpy as np
import pytest

from tests.sim.physics.rigs import GUPPY
from truearc.sim.physics.catalogue import find_terms
from truearc.sim.physics.term import BallState, Exit, Opening
from truearc.sim.physics.vector import Vec

LEVEL = BallState(Vec(0.0, 0.0, 1.0), Vec(10.0, 0.0, 0.0), Vec(0.0, -5.0, 0.0), 0.5)
FORCES = {"gravity": Vec(0.0, 0.0, -9.81), "drag": Vec(-5.0, 0.0, 0.0), "magnus": Vec(0.0, 0.0, 2.0)}
LEAVING = Exit(12.0, 0.7, 3.0, 0.0)
S = 2 * np.pi * 0.0889 * 5 / 10       # surface speed over speed of LEVEL
VOLUME_M3 = 4 / 3 * np.pi * 0.0889**3


def _force(name, values, ball=LEVEL):
    term, = find_terms([name])
    return np.array(term.acceleration(GUPPY, values, ball, FORCES), float)


def _left(name, values):
    term, = find_terms([name])
    return np.array(term.leave(GUPPY, values, LEAVING))


def _sensed(name, values):
    term, = find_terms([name])
    exit, distance_m = term.sense(GUPPY, values, LEAVING, 4.0)
    return np.array([*exit, distance_m])


def _watched(name, values, place=(3.0, 0.2, 2.0), speed=(6.0, 0.1, -1.0), time_s=0.5):
    term, = find_terms([name])
    return np.array(term.watch(values, Vec(*place), Vec(*speed), time_s))


@pytest.mark.parametrize(("name", "values", "expected"), [
    ("magnus", {"cl": 0.06}, (0, 0, 0.06 * 4 / 3 * 4 * np.pi**2 * 0.0889**3 * 5 * 1.2 * 10 / 0.14)),
    ("drag", {"cd": 0.91}, (-0.91 / 2 * np.pi * 0.0889**2 * 100 * 1.2 / 0.14, 0, 0)),
    ("spin_drag", {"share": 0.3}, (-0.3 * S**2 / 2 * np.pi * 0.0889**2 * 100 * 1.2 / 0.14, 0, 0)),
    ("drag_reynolds", {"slope": 0.3, "at_m_s": 8.0}, (-5.0 * 0.3 * 0.25, 0, 0)),
    ("lift_saturation", {"rate": 0.8}, (0, 0, 2.0 * (1 / (1 + 0.8 * S) - 1))),
    ("drag_wear", {"share": 0.1}, (-0.5, 0, 0)),
    ("air_density", {"share": 0.04}, (-0.2, 0, 0.08)),
    ("air_change", {"share": 0.04}, (-0.2, 0, 0.08)),
    ("buoyancy", {"share": 1.0}, (0, 0, 1.2 * VOLUME_M3 * 9.81 / 0.14)),
    ("added_mass", {"share": 1.0}, np.array([-5.0, 0, -7.81]) * (1 / (1 + 0.6 * VOLUME_M3 / 0.14) - 1)),
])
def test_forces(name, values, expected):
    """A level ball at 10 m/s with five turns a second of backspin: it is lifted, slowed and carried."""
    np.testing.assert_allclose(_force(name, values), expected, rtol=1e-12, atol=1e-14)


def test_a_ball_floats_by_two_and_a_half_per_cent_of_its_weight():
    assert _force("buoyancy", {"share": 1.0})[2] / 9.81 == pytest.approx(0.0252, abs=1e-4)


@pytest.mark.parametrize("name", ["drag_reynolds", "lift_saturation", "drag_wear", "air_density", "air_change",
                                  "added_mass"])
def test_a_share_of_nothing_is_nothing(name):
    term, = find_terms([name])
    values = {p.name: 0.5 for p in term.parameters}
    assert tuple(term.acceleration(GUPPY, values, LEVEL, {})) == (0.0, 0.0, 0.0)


def test_the_air_that_the_ball_meets():
    decay, *winds = find_terms(["spin_decay", "wind_x", "wind_y", "wind_z"])
    ball = LEVEL
    for wind, speed_m_s in zip(winds, (3.0, 2.0, -0.5), strict=True):
        ball = wind.meet(GUPPY, {"speed_m_s": speed_m_s}, ball)
    assert tuple(ball.velocity_m_s) == (7.0, -2.0, 0.5)
    assert float(decay.meet(GUPPY, {"rate_per_s": 0.4}, LEVEL).spin_rev_s.y) == pytest.approx(-5.0 * np.exp(-0.2))


@pytest.mark.parametrize(("name", "values", "expected"), [
    ("exit_efficiency", {"loss": 0.25}, (9.0, 0.7, 3.0, 0.0)),
    ("wheel_slip", {"loss_per_m_s": 1 / 36}, (9.0, 0.7, 3.0, 0.0)),
    ("wheel_droop", {"loss": 0.25}, (9.0, 0.7, 3.0, 0.0)),
    ("ball_compression", {"share": 0.25}, (12.0, 0.7, 4.0, 0.0)),
    ("ball_wear", {"loss": 0.25}, (9.0, 0.7, 3.0, 0.0)),
    ("ball_spread", {"spread": -0.25}, (9.0, 0.7, 3.0, 0.0)),
    ("battery_sag", {"sensitivity": -0.25}, (9.0, 0.7, 3.0, 0.0)),
    ("rapid_fire", {"loss": 0.25, "time_constant_s": 0.7}, (9.0, 0.7, 3.0, 0.0)),
    ("release_height", {"above_m": 0.05}, (12.0, 0.7, 3.0, 0.05)),
])
def test_launches(name, values, expected):
    np.testing.assert_allclose(_left(name, values), expected, rtol=1e-14)


@pytest.mark.parametrize(("name", "values", "expected"), [
    ("hood_offset", {"angle_deg": 1.8}, (12.0, 0.7 + np.pi / 100, 3.0, 0.0, 4.0)),
    ("hood_backlash", {"angle_deg": -1.8}, (12.0, 0.7 - np.pi / 100, 3.0, 0.0, 4.0)),
    ("encoder_scale", {"share": 0.02}, (12.24, 0.7, 3.06, 0.0, 4.0)),
    ("distance_scale", {"share": 0.02}, (12.0, 0.7, 3.0, 0.0, 4.08)),
    ("distance_bias", {"bias_m": 0.05}, (12.0, 0.7, 3.0, 0.0, 4.05)),
    ("vision_latency", {"delay_s": 0.1}, (12.0, 0.7, 3.0, 0.0, 3.9)),
])
def test_what_is_true_of_what_was_sensed(name, values, expected):
    np.testing.assert_allclose(_sensed(name, values), expected, rtol=1e-14)


def test_what_a_tracker_says():
    np.testing.assert_allclose(_watched("track_scale", {"share": 0.02}), (3.06, 0.204, 2.04), rtol=1e-14)
    np.testing.assert_allclose(_watched("track_tilt", {"angle_deg": 90.0}), (-2.0, 0.2, 3.0), atol=1e-14)
    np.testing.assert_allclose(_watched("track_roll", {"angle_deg": 90.0}), (3.0, -2.0, 0.2), atol=1e-14)
    np.testing.assert_allclose(_watched("track_perspective", {"per_m": 0.01}), (3.06, 0.204, 2.04), rtol=1e-14)
    np.testing.assert_allclose(_watched("track_clock", {"share": 0.02}), (3.06, 0.201, 1.99), rtol=1e-14)


def test_the_opening():
    rise, = find_terms(["target_height"])
    catch, = find_terms(["rim_catch"])
    hole = Opening(2.44, 0.07, 0.35)
    np.testing.assert_allclose(rise.arrive({"rise_m": -0.04}, hole), (2.40, 0.07, 0.35))
    np.testing.assert_allclose(catch.arrive({"reach_m": 0.03}, hole), (2.44, 0.10, 0.38))
