"""The law written out for numba against the law itself, in JAX."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, final

import jax.numpy as jnp
import msgspec
import numpy as np
import pytest

import truearc.sim.paper
from tests.sim.physics.rigs import GUPPY
from truearc.sim.paper.grid_labels import UntraceableLaw, facts_values, load_kernel, make_source
from truearc.sim.physics.catalogue import flight_terms
from truearc.sim.physics.flight import make_law
from truearc.sim.physics.term import BallState, FlightTerm, Parameter, Vec, length, scale

TEMPLATE = Path(truearc.sim.paper.__file__).parent / "grid_kernel.py"
TERMS = flight_terms(("gravity", "drag", "magnus"))
VALUES = (("drag", "cd"), ("magnus", "cl"))


@final
@dataclass(frozen=True)
class Odd(FlightTerm):
    """Uses one of everything that a term might."""

    name: ClassVar[str] = "odd"
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter("amount", "1", 0.0, 5.0, 0.3, "made up"),)
    sentence: ClassVar[str] = ""

    def acceleration(self, rig: Any, values: Mapping[str, Any], ball: BallState,
                     forces: Mapping[str, Vec]) -> Vec:
        v, z = ball.velocity_m_s, ball.position_m.z
        size = jnp.where(z > 1.0, jnp.exp(-z), jnp.tanh(v.x)) + jnp.maximum(v.x, 0.1) ** 3 + jnp.abs(v.z) ** 1.5
        size = size + jnp.sin(v.x) * jnp.arctan2(v.z, v.x) + jnp.log1p(length(v)) / (1.0 + z**2) + jnp.sign(v.z)
        return scale(values["amount"] * size, Vec(v.x, 0.0, v.z))


@final
@dataclass(frozen=True)
class Sideways(FlightTerm):
    name: ClassVar[str] = "sideways"
    parameters: ClassVar[tuple[Parameter, ...]] = (Parameter("amount", "m/s2", 0.0, 5.0, 1.0, "made up"),)
    sentence: ClassVar[str] = ""

    def acceleration(self, rig: Any, values: Mapping[str, Any], ball: BallState,
                     forces: Mapping[str, Vec]) -> Vec:
        return Vec(0.0, values["amount"] * ball.velocity_m_s.x, 0.0)


def _said(rig, terms, states, pairs, keep=None):
    """Acceleration by the compiled law, [n, 2]."""
    kernel = load_kernel(make_source(rig, terms, VALUES), TEMPLATE, keep)
    numbers = facts_values(rig)
    return np.array([kernel.acceleration(*map(float, state), tuple(map(float, pair)), numbers)
                     for state, pair in zip(states, pairs, strict=True)])


def _law(rig, terms, states, pairs, more=None):
    x, z, vx, vz, spin = states.T
    ball = BallState(Vec(x, 0.0, z), Vec(vx, 0.0, vz), Vec(0.0, -spin, 0.0))
    pushed = make_law(rig, terms, {**(more or {}), "drag": {"cd": pairs[:, 0]}, "magnus": {"cl": pairs[:, 1]}})(ball)
    return np.stack([np.broadcast_to(np.asarray(part, float), x.shape) for part in (pushed.x, pushed.z)], axis=1)


def _draw(seed, count=60):
    rng = np.random.default_rng(seed)
    states = np.stack([rng.uniform(0, 16, count), rng.uniform(0, 10, count), rng.uniform(0.1, 20, count),
                       rng.uniform(-20, 20, count), rng.uniform(-5, 35, count)], axis=1)
    return states, rng.uniform(0, 5, (count, 2))


@pytest.mark.parametrize("terms", [TERMS, (*TERMS, Odd()), TERMS[:1]], ids=["catalogue", "one more", "weight only"])
def test_it_is_the_law(terms):
    states, pairs = _draw(3)
    np.testing.assert_allclose(_said(GUPPY, terms, states, pairs), _law(GUPPY, terms, states, pairs), rtol=1e-12,
                               atol=1e-12)


def test_one_source_serves_every_rig():
    """A heavier ball in thinner air takes the same source with other numbers."""
    other = msgspec.structs.replace(GUPPY, ball=msgspec.structs.replace(GUPPY.ball, mass_kg=0.3),
                                    air=msgspec.structs.replace(GUPPY.air, density_kg_m3=0.9))
    assert make_source(other, TERMS, VALUES) == make_source(GUPPY, TERMS, VALUES)
    states, pairs = _draw(4)
    np.testing.assert_allclose(_said(other, TERMS, states, pairs), _law(other, TERMS, states, pairs), rtol=1e-12)


def test_what_cannot_be_written_out_is_refused_by_name():
    with pytest.raises(UntraceableLaw, match="sideways"):
        make_source(GUPPY, (*TERMS, Sideways()), VALUES)


NEW = {"spin_drag": {"share": 0.4}, "drag_reynolds": {"slope": -0.3}, "lift_saturation": {"rate": 1.1},
       "buoyancy": {"share": 1.0}, "added_mass": {"share": 1.0}, "wind_x": {"speed_m_s": 1.2}}


@pytest.mark.parametrize("name", NEW)
def test_terms_of_the_catalogue_are_written_out_too(name):
    terms, (key, size), = flight_terms(("gravity", "drag", "magnus", name)), *NEW[name].items()
    states, pairs = _draw(6, 20)
    kernel = load_kernel(make_source(GUPPY, terms, (*VALUES, (name, key))), TEMPLATE)
    said = [kernel.acceleration(*map(float, state), (*map(float, pair), size), facts_values(GUPPY))
            for state, pair in zip(states, pairs, strict=True)]
    np.testing.assert_allclose(said, _law(GUPPY, terms, states, pairs, NEW), rtol=1e-12, atol=1e-12)


def test_a_law_that_changes_in_flight_is_refused():
    with pytest.raises(UntraceableLaw, match="time since release"):
        make_source(GUPPY, flight_terms(("gravity", "magnus", "spin_decay")), VALUES)
