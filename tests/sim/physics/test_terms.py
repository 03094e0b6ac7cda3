"""What every term of the catalogue has to satisfy, measured over the registry."""

import re

import jax
import jax.numpy as jnp
import msgspec
import numpy as np
import pytest

from robot.config import BadInput
from sim.physics.catalogue import TERMS, find_parameter, find_terms, flight_terms, launch_terms
from sim.physics.launch import Exit
from sim.physics.scales import SCALES, fits_scale, from_scale, to_scale
from sim.physics.term import STAGES, BallState, FlightTerm, LaunchTerm, complete
from sim.physics.vector import Vec
from tests.sim.physics.rigs import GUPPY

FLIGHT = [term for term in TERMS if isinstance(term, FlightTerm)]
LAUNCH = [term for term in TERMS if isinstance(term, LaunchTerm)]
every_launch_term = pytest.mark.parametrize("term", LAUNCH, ids=lambda term: term.name)
every_term = pytest.mark.parametrize("term", TERMS, ids=lambda term: term.name)
every_flight_term = pytest.mark.parametrize("term", FLIGHT, ids=lambda term: term.name)


def _state(seed: int) -> np.ndarray:
    """Position, velocity and spin, nine numbers."""
    rng = np.random.default_rng(seed)
    return np.concatenate([rng.uniform(0, 5, 3), rng.uniform(-15, 15, 3), rng.uniform(-20, 20, 3)])


def _acceleration(term, values, state) -> jnp.ndarray:
    ball = BallState(*(Vec(*state[first:first + 3]) for first in (0, 3, 6)))
    return jnp.stack([jnp.asarray(part, dtype=float) for part in term.acceleration(GUPPY, values, ball, {})])


def _typical(term) -> dict[str, float]:
    return {p.name: p.low + 0.37 * (p.high - p.low) for p in term.parameters}


@every_term
def test_declares_itself(term):
    assert term.stage in STAGES
    assert term.symmetry in ("any", "vertical", "none")
    assert term.sentence.endswith(".")
    assert term.parameters
    for parameter in term.parameters:
        assert parameter.low < parameter.high
        assert parameter.low <= parameter.default <= parameter.high
        assert parameter.source
        if parameter.prior is not None:
            assert parameter.prior.scale in SCALES
            assert parameter.prior.sd > 0.0
            assert len(parameter.prior.reason) > 20
            assert fits_scale(parameter.prior.scale, parameter.prior.centre)
        assert find_parameter(f"{term.name}.{parameter.name}") is parameter


@every_term
def test_scales_go_there_and_back(term):
    for parameter in term.parameters:
        if parameter.prior is not None:
            for value in np.linspace(parameter.low, parameter.high, 7)[1:]:
                number = to_scale(parameter.prior.scale, value)
                assert float(from_scale(parameter.prior.scale, number)) == pytest.approx(value, rel=1e-12)


def test_names_are_those_of_the_files_and_unique():
    names = [term.name for term in TERMS]
    assert len(set(names)) == len(names)
    for term in TERMS:
        assert type(term).__module__ == f"sim.physics.terms.{term.name}"


@every_flight_term
def test_zero_amplitude_is_absence(term):
    values = _typical(term) | {term.parameters[0].name: 0.0}
    assert np.all(np.asarray(_acceleration(term, values, _state(1))) == 0.0)
    assert np.any(np.asarray(_acceleration(term, _typical(term), _state(1))) != 0.0)


@every_flight_term
@pytest.mark.parametrize("speed", [1.0, 0.0])
def test_gradients_are_finite_also_at_rest(term, speed):
    state = _state(2)
    state[3:6] *= speed
    in_values = jax.jacfwd(lambda values: _acceleration(term, values, state))(_typical(term))
    in_state = jax.jacfwd(lambda state: _acceleration(term, _typical(term), state))(state)
    assert all(np.isfinite(part).all() for part in jax.tree.leaves((in_values, in_state)))


@every_flight_term
def test_turns_with_the_state(term):
    if term.symmetry == "none":
        pytest.skip("declares a direction of its own")
    for seed in range(5):
        turn = _rotation(np.random.default_rng(seed), about_z=term.symmetry == "vertical")
        state = _state(seed)
        turned = np.concatenate([turn @ state[first:first + 3] for first in (0, 3, 6)])
        expected = turn @ np.asarray(_acceleration(term, _typical(term), state))
        np.testing.assert_allclose(_acceleration(term, _typical(term), turned), expected, rtol=1e-12, atol=1e-12)


def _rotation(rng: np.random.Generator, about_z: bool) -> np.ndarray:
    if about_z:
        angle = rng.uniform(0, 2 * np.pi)
        return np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return turn * np.sign(np.linalg.det(turn))


@every_flight_term
def test_units_are_dimensionally_right(term):
    """In other units of length, time and mass the same flight has the same acceleration."""
    length, time, mass = 3.7, 0.6, 11.0
    facts = msgspec.structs.replace(
        GUPPY,
        ball=msgspec.structs.replace(GUPPY.ball, mass_kg=GUPPY.ball.mass_kg * mass,
                                     radius_m=GUPPY.ball.radius_m * length),
        air=msgspec.structs.replace(GUPPY.air, density_kg_m3=GUPPY.air.density_kg_m3 * mass / length**3),
        world=msgspec.structs.replace(GUPPY.world, gravity_m_s2=GUPPY.world.gravity_m_s2 * length / time**2))
    values = {p.name: _typical(term)[p.name] * _factor(p.unit, length, time, mass) for p in term.parameters}
    state = _state(3)
    scaled = np.concatenate([state[:3] * length, state[3:6] * length / time, state[6:] / time])
    ball = BallState(*(Vec(*scaled[first:first + 3]) for first in (0, 3, 6)))
    there = np.array([float(part) for part in term.acceleration(facts, values, ball, {})])
    here = np.asarray(_acceleration(term, _typical(term), state))
    np.testing.assert_allclose(there, here * length / time**2, rtol=1e-12, atol=1e-12)


def _factor(unit: str, length: float, time: float, mass: float) -> float:
    """What a number with this unit ("1", "m/s2", "kg/m3", ...) is multiplied by in the other units."""
    bases = {"m": length, "s": time, "kg": mass, "rad": 1.0, "rev": 1.0, "1": 1.0}
    above, _, below = unit.partition("/")
    factor = 1.0
    for part, sign in ((above, 1), (below, -1)):
        for base, power in re.findall(r"(kg|rad|rev|m|s|1)(\d*)", part):
            factor *= bases[base] ** (sign * int(power or 1))
    return factor


EXITS = Exit(np.array([0.5, 4.0, 9.0, 21.0]), np.array([0.1, 0.5, 0.9, 1.3]), np.array([-3.0, 0.0, 4.0, 11.0]))


def _left(term, values, exit=EXITS) -> np.ndarray:
    return np.stack([np.broadcast_to(part, 4) for part in term.leave(GUPPY, values, exit)])


@every_launch_term
def test_a_launch_term_of_zero_amplitude_changes_no_bit(term):
    values = _typical(term) | {term.parameters[0].name: 0.0}
    np.testing.assert_array_equal(_left(term, values), np.stack([np.broadcast_to(part, 4) for part in EXITS]))
    assert np.any(_left(term, _typical(term)) != np.stack([np.broadcast_to(part, 4) for part in EXITS]))


@every_launch_term
def test_launch_terms_have_finite_gradients(term):
    """In their values, zero amplitude included, and in the launch, rest included."""
    at_rest = Exit(*(0.0 * part for part in EXITS))
    for values in (_typical(term), {p.name: 0.0 for p in term.parameters}):
        for exit in (EXITS, at_rest):
            slopes = jax.jacfwd(lambda values, exit: tuple(term.leave(GUPPY, values, exit)), argnums=(0, 1))(
                values, Exit(*map(jnp.asarray, exit)))
            assert all(np.isfinite(part).all() for part in jax.tree.leaves(slopes))
    slopes = jax.jacfwd(lambda v: tuple(term.leave(GUPPY, v, EXITS)))(_typical(term))
    assert any(np.any(np.asarray(part[term.parameters[0].name]) != 0.0) for part in slopes if isinstance(part, dict))


@every_launch_term
def test_launch_terms_have_the_units_they_declare(term):
    length, time, mass = 3.7, 0.6, 11.0
    values = {p.name: _typical(term)[p.name] * _factor(p.unit, length, time, mass) for p in term.parameters}
    facts = msgspec.structs.replace(GUPPY, ball=msgspec.structs.replace(
        GUPPY.ball, mass_kg=GUPPY.ball.mass_kg * mass, radius_m=GUPPY.ball.radius_m * length))
    scaled = Exit(EXITS.speed_m_s * length / time, EXITS.elevation_rad, EXITS.spin_rev_s / time)
    there = term.leave(facts, values, scaled)
    here = term.leave(GUPPY, _typical(term), EXITS)
    np.testing.assert_allclose(there.speed_m_s, here.speed_m_s * length / time, rtol=1e-12)
    np.testing.assert_allclose(there.elevation_rad, here.elevation_rad, rtol=1e-12)
    np.testing.assert_allclose(there.spin_rev_s, here.spin_rev_s / time, rtol=1e-12)


def test_launch_terms_by_hand():
    slip, loss = launch_terms(["exit_efficiency", "wheel_slip"])
    assert loss.leave(GUPPY, {"loss": 0.25}, Exit(12.0, 0.7, 3.0)) == Exit(9.0, 0.7, 3.0)
    assert slip.leave(GUPPY, {"loss_per_m_s": 0.02}, Exit(12.5, 0.7, 3.0)) == Exit(10.0, 0.7, 3.0)


def test_magnus_lifts_a_ball_with_backspin():
    """The seed's Eq. 2 by hand: 0.06 (4/3) 4 pi^2 r^3 s rho v / m, upward for a ball that flies level."""
    magnus, = find_terms(["magnus"])
    ball = BallState(Vec(0., 0., 1.), Vec(10.0, 0.0, 0.0), Vec(0., -5., 0.))
    lift = magnus.acceleration(GUPPY, {"cl": 0.06}, ball, {})
    assert lift.z == pytest.approx(0.06 * 4 / 3 * 4 * np.pi**2 * 0.0889**3 * 5 * 1.2 * 10 / 0.14, rel=1e-12)
    assert lift.x == 0.0


def test_drag_slows():
    """The seed's Eq. 3 by hand: 0.91/2 A v^2 rho / m, against the velocity."""
    drag, = find_terms(["drag"])
    ball = BallState(Vec(0., 0., 1.), Vec(0.0, 0.0, -10.0), Vec(0., -5., 0.))
    slow = drag.acceleration(GUPPY, {"cd": 0.91}, ball, {})
    assert slow.z == pytest.approx(0.91 / 2 * np.pi * 0.0889**2 * 100 * 1.2 / 0.14, rel=1e-12)


def test_the_seeds_believed_terms_are_there():
    assert [term.name for term in flight_terms(GUPPY.believe.terms)] == ["gravity", "drag", "magnus"]
    with pytest.raises(BadInput, match="no term 'gravitas'"):
        find_terms(["gravitas"])


def test_absent_parameters_take_their_defaults():
    gravity, drag, _ = find_terms(["gravity", "drag", "magnus"])
    assert complete(gravity, None) == {"scale": 1.0}
    assert complete(drag, {"cd": 0.5}) == {"cd": 0.5}
