"""What every term of the catalogue has to satisfy, measured over the registry."""

import jax
import numpy as np
import pytest

from tests.sim.physics.hooks import (
    DISTANCES_M,
    EXITS,
    FLOWN_S,
    HOLE,
    call,
    factor,
    finite,
    rescaled,
    state,
    typical,
    untouched,
)
from tests.sim.physics.rigs import GUPPY
from truearc.errors import InputError
from truearc.sim.data.conditions import Circumstances
from truearc.sim.physics.catalogue import (
    TERMS,
    arrival_terms,
    check_term,
    effective,
    find_parameter,
    find_terms,
    flight_terms,
    launch_terms,
    sensing_terms,
    watch_terms,
)
from truearc.sim.physics.term import AirTerm, FlightTerm, complete, from_scale, to_scale

NAMES = tuple(term.name for term in TERMS)
IN_THE_AIR = [term for term in TERMS if isinstance(term, FlightTerm | AirTerm)]
KNOWN = {"gravity": {"scale"}, "drag_reynolds": {"at_m_s"}}        # parameters that are not fitted
# the terms of the file formats' first version, and those added since
STAGES = {
    "sensing": "hood_offset hood_backlash encoder_scale distance_scale distance_bias vision_latency track_scale "
               "track_tilt track_roll track_clock track_perspective",
    "launch": "exit_efficiency wheel_slip wheel_droop ball_compression ball_wear ball_spread battery_sag rapid_fire "
              "release_height",
    "flight": "gravity drag magnus buoyancy added_mass spin_decay spin_drag drag_reynolds lift_saturation wind_x "
              "wind_y wind_z air_density air_change drag_wear",
    "arrival": "target_height rim_catch",
}
every_term = pytest.mark.parametrize("term", TERMS, ids=lambda term: term.name)
every_term_in_the_air = pytest.mark.parametrize("term", IN_THE_AIR, ids=lambda term: term.name)


@every_term
def test_declares_itself(term):
    check_term(term)
    assert len(term.sentence) > 20
    assert len(term.order[1]) > 10
    for parameter in term.parameters:
        assert len(parameter.source) > 20
        assert len(parameter.meaning) > 10
        assert (parameter.prior is None) == (parameter.name in KNOWN.get(term.name, ()))
        if parameter.prior is not None:
            assert len(parameter.prior.reason) > 20
        assert find_parameter(f"{term.name}.{parameter.name}") is parameter


@every_term
def test_absent_unless_someone_says_so(term):
    if term.name != "gravity":
        assert term.parameters[0].default == 0.0
        assert term.parameters[0].low <= 0.0 < term.parameters[0].high


@every_term
def test_scales_go_there_and_back(term):
    for parameter in term.parameters:
        if parameter.prior is not None:
            for value in np.linspace(parameter.low, parameter.high, 7)[1:]:
                number = to_scale(parameter.prior.scale, value)
                assert float(from_scale(parameter.prior.scale, number)) == pytest.approx(value, rel=1e-12, abs=1e-15)


def test_names_are_unique_and_terms_on_the_page_of_their_stage():
    assert len(set(NAMES)) == len(NAMES)
    for term in TERMS:
        assert type(term).__module__ == f"truearc.sim.physics.terms.{term.stage}"


def test_each_stage_has_its_terms_and_each_term_the_hook_of_its_stage():
    for stage, names in STAGES.items():
        assert {term.name for term in TERMS if term.stage == stage} == set(names.split())
    hooks = {"sensing": (*sensing_terms(NAMES), *watch_terms(NAMES)), "launch": launch_terms(NAMES),
             "flight": flight_terms(NAMES), "arrival": arrival_terms(NAMES)}
    for stage, terms in hooks.items():
        assert {term.name for term in terms} == set(STAGES[stage].split())


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
    exit = EXITS._replace(speed_m_s=EXITS.speed_m_s * speed, spin_rev_s=EXITS.spin_rev_s * speed)
    for values in (typical(term), typical(term) | {term.parameters[0].name: 0.0}):
        by_values = jax.jacfwd(lambda values: call(term, values, numbers, exit=exit))(values)
        by_state = jax.jacfwd(lambda now, exit, values=values: call(term, values, now, exit=exit), argnums=(0, 1))(
            numbers, exit)
        assert finite(by_values)
        assert finite(by_state)
    assert np.any(np.asarray(jax.jacfwd(lambda values: call(term, values))(values)[term.parameters[0].name]) != 0.0)


@every_term_in_the_air
def test_turns_with_the_state(term):
    """Beside gravity, which turns about z only, where it is tested."""
    if term.name in ("wind_x", "wind_y"):
        pytest.skip("has a direction of its own")
    vertical = term.name in ("gravity", "buoyancy", "wind_z")
    others = ("gravity", "drag", "magnus") if vertical else ("drag", "magnus")
    for seed in range(5):
        turn = _rotation(np.random.default_rng(seed), about_z=vertical)
        turned = np.concatenate([turn @ state(seed)[first:first + 3] for first in (0, 3, 6)])
        expected = np.asarray(call(term, typical(term), state(seed), others=others)) @ turn.T
        np.testing.assert_allclose(call(term, typical(term), turned, others=others), expected, rtol=1e-12, atol=1e-12)


def _rotation(rng: np.random.Generator, about_z: bool) -> np.ndarray:
    if about_z:
        angle = rng.uniform(0, 2 * np.pi)
        return np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return turn * np.sign(np.linalg.det(turn))


@every_term_in_the_air
def test_left_and_right_are_alike(term):
    """Mirrored in the vertical plane of the flight; spins, being turns, mirror the other way."""
    if term.name == "wind_y":
        pytest.skip("blows to one side")
    place, turn = np.array([1.0, -1.0, 1.0]), np.array([-1.0, 1.0, -1.0])
    mirrored = state(4) * np.concatenate([place, place, turn])
    ways = np.stack([place] if isinstance(term, FlightTerm) else [place, turn])
    np.testing.assert_allclose(call(term, typical(term), mirrored), ways * call(term, typical(term), state(4)),
                               rtol=1e-13, atol=1e-13)


@every_term
def test_units_are_dimensionally_right(term):
    """In other units of length, time and mass the same shot comes out the same."""
    length, time, mass = 3.7, 0.6, 11.0
    if term.follows == "closing_speed_m_s":
        time = 1.0                    # the effective value is a length, by a speed that is not said here
        length = 1.0
    values = {p.name: typical(term)[p.name] * factor(p.unit, length, time, mass) for p in term.parameters}
    speed = length / time
    numbers = state(3) * np.repeat([length, speed, 1.0 / time], 3)
    exit = EXITS._replace(speed_m_s=EXITS.speed_m_s * speed, spin_rev_s=EXITS.spin_rev_s / time,
                          above_m=EXITS.above_m * length)
    there = call(term, values, numbers, rig=rescaled(length, time, mass), exit=exit, distance_m=DISTANCES_M * length,
                 hole=type(HOLE)(*(part * length for part in HOLE)), time_s=FLOWN_S * time)
    here = np.asarray(call(term, typical(term), state(3)))
    rows = {"sensing": (speed, 1.0, 1.0 / time, length, length), "launch": (speed, 1.0, 1.0 / time, length)}
    in_units = {"flight": (length / time**2,) if isinstance(term, FlightTerm) else (speed, 1.0 / time),
                "arrival": (length,), **rows}[term.stage]
    if len(here) == 1:
        in_units = in_units if term.stage == "flight" else (length,)
    np.testing.assert_allclose(there, here * np.array(in_units)[:, None], rtol=1e-12, atol=1e-12)


@every_term
def test_what_it_follows_scales_its_amplitude(term):
    shot = Circumstances(**{name: np.array([0.3, -1.2]) for name in Circumstances._fields})
    values = effective({term.name: {p.name: typical(term)[p.name] for p in term.parameters}}, shot)[term.name]
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
    values = effective({term.name: typical(term)}, Circumstances())[term.name]
    followed = term.follows not in (None, "droop") or term.name == "rapid_fire"
    assert (float(values[term.parameters[0].name]) == 0.0) == followed


def test_the_seeds_believed_terms_are_there():
    assert [term.name for term in flight_terms(GUPPY.believe.terms)] == ["gravity", "drag", "magnus"]
    with pytest.raises(InputError, match="no term 'gravitas'"):
        find_terms(["gravitas"])


def test_absent_parameters_take_their_defaults():
    gravity, drag, _ = find_terms(["gravity", "drag", "magnus"])
    assert complete(gravity, None) == {"scale": 1.0}
    assert complete(drag, {"cd": 0.5}) == {"cd": 0.5}
