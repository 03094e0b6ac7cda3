"""What every term of the catalogue has to satisfy, and what single terms say, worked out by hand."""

import jax
import numpy as np
import pytest

from tests.sim.physics import hooks
from tests.sim.physics.hooks import call, state, typical, untouched
from tests.sim.physics.rigs import GUPPY
from truearc.sim.data.dataset import Circumstances
from truearc.sim.physics import catalogue
from truearc.sim.physics.catalogue import TERMS, find_terms
from truearc.sim.physics.term import BallState, Exit, FlightTerm, Opening, Vec, from_scale, to_scale

KNOWN = {"gravity": {"scale"}, "drag_reynolds": {"at_m_s"}}        # parameters that are not fitted
every_term = pytest.mark.parametrize("term", TERMS, ids=lambda term: term.name)


@every_term
def test_what_is_fitted_has_a_prior_and_is_found_by_name(term):
    for parameter in term.parameters:
        assert (parameter.prior is None) == (parameter.name in KNOWN.get(term.name, ()))
        assert catalogue.find_parameter(f"{term.name}.{parameter.name}") is parameter


@every_term
def test_scales_go_there_and_back(term):
    for parameter in term.parameters:
        if parameter.prior is not None:
            for value in np.linspace(parameter.low, parameter.high, 7)[1:]:
                number = to_scale(parameter.prior.scale, value)
                assert float(from_scale(parameter.prior.scale, number)) == pytest.approx(value, rel=1e-12, abs=1e-15)


@every_term
def test_zero_amplitude_changes_no_bit(term):
    values = typical(term) | {term.parameters[0].name: 0.0}
    np.testing.assert_array_equal(call(term, values), untouched(term))
    assert np.any(np.asarray(call(term, typical(term))) != untouched(term))


@every_term
@pytest.mark.parametrize("speed", [1.0, 0.0])
def test_gradients_are_finite_also_at_rest_and_at_zero(term, speed):
    numbers = state(2)
    numbers[3:6] *= speed
    exit = hooks.EXITS._replace(speed_m_s=hooks.EXITS.speed_m_s * speed, spin_rev_s=hooks.EXITS.spin_rev_s * speed)
    for values in (typical(term), typical(term) | {term.parameters[0].name: 0.0}):
        by_values = jax.jacfwd(lambda values: call(term, values, numbers, exit=exit))(values)
        by_state = jax.jacfwd(lambda now, exit, values=values: call(term, values, now, exit=exit), argnums=(0, 1))(
            numbers, exit)
        assert hooks.finite(by_values)
        assert hooks.finite(by_state)
    assert np.any(np.asarray(jax.jacfwd(lambda values: call(term, values))(values)[term.parameters[0].name]) != 0.0)


@every_term
def test_units_are_dimensionally_right(term):
    """In other units of length, time and mass the same shot comes out the same."""
    length, time, mass = 3.7, 0.6, 11.0
    if term.follows == "closing_speed_m_s":
        time = 1.0                    # the effective value is a length, by a speed that is not said here
        length = 1.0
    values = {p.name: typical(term)[p.name] * hooks.factor(p.unit, length, time, mass) for p in term.parameters}
    speed = length / time
    numbers = state(3) * np.repeat([length, speed, 1.0 / time], 3)
    exit = hooks.EXITS._replace(speed_m_s=hooks.EXITS.speed_m_s * speed, spin_rev_s=hooks.EXITS.spin_rev_s / time,
                          above_m=hooks.EXITS.above_m * length)
    there = call(term, values, numbers, rig=hooks.rescaled(length, time, mass), exit=exit,
                 distance_m=hooks.DISTANCES_M * length, hole=hooks.HOLE._make(part * scale for part, scale in zip(
                     hooks.HOLE, (length, length, length, 1.0), strict=True)),
                 time_s=hooks.FLOWN_S * time)
    here = np.asarray(call(term, typical(term), state(3)))
    rows = {"sensing": (speed, 1.0, 1.0 / time, length, length), "launch": (speed, 1.0, 1.0 / time, length)}
    in_units = {"flight": (length / time**2,) if isinstance(term, FlightTerm) else (speed, 1.0 / time),
                "arrival": ((length, length, length, 1.0),), **rows}[term.stage]
    if len(here) == 1:
        in_units = in_units if term.stage in ("flight", "arrival") else (length,)
    scale = np.array(in_units).reshape(len(here), -1)
    np.testing.assert_allclose(there, here * scale, rtol=1e-12, atol=1e-12)


@every_term
def test_what_it_follows_scales_its_amplitude(term):
    shot = Circumstances(**{name: np.array([0.3, -1.2]) for name in Circumstances._fields})
    values = catalogue.effective({term.name: {p.name: typical(term)[p.name] for p in term.parameters}}, shot)[term.name]
    name = term.parameters[0].name
    amplitude = typical(term)[name]
    if term.name == "rapid_fire":
        expected = amplitude * np.exp(-np.array([0.3, -1.2]) / typical(term)["time_constant_s"])
    else:
        expected = amplitude * (np.array([0.3, -1.2]) if term.follows else 1.0)
    np.testing.assert_allclose(values[name], expected, rtol=1e-14)
    assert {key: values[key] for key in values if key != name} == {
        p.name: typical(term)[p.name] for p in term.parameters[1:]}


@every_term
def test_an_ordinary_shot_knows_no_departure(term):
    """Terms that follow something are absent where it is unknown; a wheel's dip is then the mean one."""
    values = catalogue.effective({term.name: typical(term)}, Circumstances())[term.name]
    followed = term.follows not in (None, "droop") or term.name == "rapid_fire"
    assert (float(values[term.parameters[0].name]) == 0.0) == followed


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
    ("added_mass", {"share": 1.0}, np.array([-5.0, 0, -7.81]) * (1 / (1 + 0.6 * VOLUME_M3 / 0.14) - 1))])
def test_forces(name, values, expected):
    """A level ball at 10 m/s with five turns a second of backspin: it is lifted, slowed and carried."""
    np.testing.assert_allclose(_force(name, values), expected, rtol=1e-12, atol=1e-14)


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
    ("release_height", {"above_m": 0.05}, (12.0, 0.7, 3.0, 0.05))])
def test_launches(name, values, expected):
    np.testing.assert_allclose(_left(name, values), expected, rtol=1e-14)


@pytest.mark.parametrize(("name", "values", "expected"), [
    ("hood_offset", {"angle_deg": 1.8}, (12.0, 0.7 + np.pi / 100, 3.0, 0.0, 4.0)),
    ("hood_backlash", {"angle_deg": -1.8}, (12.0, 0.7 - np.pi / 100, 3.0, 0.0, 4.0)),
    ("encoder_scale", {"share": 0.02}, (12.24, 0.7, 3.06, 0.0, 4.0)),
    ("distance_scale", {"share": 0.02}, (12.0, 0.7, 3.0, 0.0, 4.08)),
    ("distance_bias", {"bias_m": 0.05}, (12.0, 0.7, 3.0, 0.0, 4.05)),
    ("vision_latency", {"delay_s": 0.1}, (12.0, 0.7, 3.0, 0.0, 3.9))])
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
    bounce, = find_terms(["backboard_bounce"])
    np.testing.assert_allclose(rise.arrive({"rise_m": -0.04}, hole), (2.40, 0.07, 0.35, 0.6))
    np.testing.assert_allclose(catch.arrive({"reach_m": 0.03}, hole), (2.44, 0.10, 0.38, 0.6))
    np.testing.assert_allclose(bounce.arrive({"more": 0.1}, hole), (2.44, 0.07, 0.35, 0.7))
