"""The believed simulation with small extra accelerations added, on top of the catalogue's terms (JAX).

Positions at the times at which a track was sampled, and the height at a plane, with their derivatives.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from robot.facts import Facts
from sim.discover.evidence import Array
from sim.physics.flight import Law, make_law, rk4
from sim.physics.term import BallState, FlightTerm
from sim.physics.vector import Vec, add

DIRECTIONS = ("along", "vertical", "lateral")
STEP_S = 0.02                         # longest step between samples; the extra forces need no finer one
PLANE_STEPS = 40                      # steps from the exit to the plane
SLOWEST_M_S = 0.3                     # horizontally; slower has as good as turned back
LOWEST_M = -5.0                       # below the floor: the plane is met by nothing that could be a hit
FIXED = ("gravity",)                  # terms whose parameters are known, not fitted


@dataclass(frozen=True)
class Believed:
    """What the simulation as it stands contains: terms, and the parameters that all shots share."""

    facts: Facts
    terms: tuple[FlightTerm, ...]
    shared: tuple[tuple[str, str], ...]      # (term, parameter)


class Release(NamedTuple):
    """A ball at the start of its track; arrays [..., 3], launcher frame; spin right-handed (backspin about -y)."""

    position_m: Any
    velocity_m_s: Any
    spin_rev_s: Any


def believe(facts: Facts, terms: tuple[FlightTerm, ...], without: tuple[str, ...] = ()) -> Believed:
    """All parameters of the terms are shared and fitted, but for known ones and those of terms in `without`."""
    shared = tuple((term.name, parameter.name) for term in terms for parameter in term.parameters
                   if term.name not in FIXED and term.name not in without)
    return Believed(facts, terms, shared)


def prior(believed: Believed) -> tuple[Array, Array]:
    """Mean and standard deviation [p] of a weak normal prior: low in the catalogue's range, a fifth of it wide.

    For the seed's coefficients, which range over 0-5, that is 0.5 and 1.
    """
    ranges = {(term.name, p.name): (p.low, p.high) for term in believed.terms for p in term.parameters}
    low, high = (np.array([ranges[key][end] for key in believed.shared], dtype=float) for end in (0, 1))
    return low + 0.1 * (high - low), 0.2 * (high - low)


def defaults(believed: Believed) -> Array:
    """The shared parameters [p] as the catalogue has them where nobody says anything."""
    values = {(term.name, p.name): p.default for term in believed.terms for p in term.parameters}
    return np.array([values[key] for key in believed.shared])


def axes(velocity: Vec) -> tuple[Vec, Vec, Vec]:
    """Unit vectors along the velocity, across it and up, and to the left; across ones fade as it becomes vertical."""
    flat = velocity.x**2 + velocity.y**2
    speed = jnp.sqrt(flat + velocity.z**2 + 1e-12)
    along = Vec(velocity.x / speed, velocity.y / speed, velocity.z / speed)
    level = jnp.sqrt(along.x**2 + along.y**2 + 1e-6)
    left = Vec(-along.y / level, along.x / level, 0.0 * level)
    up = Vec(-along.z * left.y, along.z * left.x, along.x * left.y - along.y * left.x)
    return along, up, left


@partial(jax.jit, static_argnames=("believed", "substeps"))
def track_positions(believed: Believed, release: Release, shared: Any, time_s: Any, substeps: int) -> tuple[Any, Any]:
    """(positions, velocities) [n, L, 3] at time_s [n, L], which starts with 0 and does not fall."""
    def one(release: Release, time_s: Any) -> tuple[Any, Any]:
        law = make_law(believed.facts, believed.terms, _values(believed, shared))
        return _fly_through(law, release, time_s, substeps)
    return jax.vmap(one)(release, time_s)


@partial(jax.jit, static_argnames=("believed", "substeps"))
def track_slopes(believed: Believed, release: Release, shared: Any, time_s: Any, substeps: int) -> tuple[Any, Any]:
    """Derivatives of positions [n, L, 3, 6] by initial position and velocity, and [n, L, 3, p] by shared parameters."""
    def one(release: Release, time_s: Any) -> tuple[Any, Any]:
        def positions(start: Any, shared: Any) -> Any:
            law = make_law(believed.facts, believed.terms, _values(believed, shared))
            moved = Release(start[:3], start[3:], release.spin_rev_s)
            return _fly_through(law, moved, time_s, substeps)[0]
        start = jnp.concatenate([release.position_m, release.velocity_m_s])
        return jax.jacfwd(positions, argnums=(0, 1))(start, shared)
    return jax.vmap(one)(release, time_s)


@partial(jax.jit, static_argnames=("believed", "substeps"))
def track_pushes(believed: Believed, release: Release, shared: Any, time_s: Any, edges_s: Any, speed_m_s: Any,
                 substeps: int) -> Any:
    """Derivatives of positions [n, L, 3, C] by extra accelerations in m/s2.

    C = directions x (throughout, one per band of flight time between `edges_s`, in proportion to the speed and as much
    at `speed_m_s`), directions outermost, as in DIRECTIONS.
    """
    def one(release: Release, time_s: Any) -> Any:
        def positions(amplitude: Any) -> Any:
            law = make_law(believed.facts, believed.terms, _values(believed, shared))
            push = partial(_push, amplitude.reshape(len(DIRECTIONS), -1), edges_s, speed_m_s)
            return _fly_through(law, release, time_s, substeps, push)[0]
        return jax.jacfwd(positions)(jnp.zeros(len(DIRECTIONS) * (len(edges_s) + 3)))
    return jax.vmap(one)(release, time_s)


def plane_heights(believed: Believed, launch: Any, spin_rev_s: Any, distance_m: Any, shared: Any) -> tuple[Any, Any]:
    """Height at the plane [n] and whether the ball came near it [n]; through the floor if need be.

    launch: [n, 6] log of the speed in m/s, elevation in rad, release height and extra distance in m, extra
    accelerations along the velocity and across it (up) in m/s2. Integrated over x, which must keep growing.
    """
    return _plane(believed, launch, spin_rev_s, distance_m, shared)


@partial(jax.jit, static_argnames=("believed",))
def _plane(believed: Believed, launch: Any, spin_rev_s: Any, distance_m: Any, shared: Any) -> tuple[Any, Any]:
    return jax.vmap(lambda one, spin, distance: _one_height(believed, one, spin, distance, shared))(
        launch, spin_rev_s, distance_m)


@partial(jax.jit, static_argnames=("believed",))
def plane_slopes(believed: Believed, launch: Any, spin_rev_s: Any, distance_m: Any, shared: Any) -> tuple[Any, Any]:
    """Derivatives of the heights by launch [n, 6] and by the shared parameters [n, p]."""
    def one(launch: Any, spin: Any, distance: Any) -> tuple[Any, Any]:
        return jax.jacfwd(lambda a, b: _one_height(believed, a, spin, distance, b)[0], argnums=(0, 1))(launch, shared)
    return jax.vmap(one)(launch, spin_rev_s, distance_m)


def _values(believed: Believed, shared: Any) -> dict[str, dict[str, Any]]:
    values: dict[str, dict[str, Any]] = {}
    for index, (term, parameter) in enumerate(believed.shared):
        values.setdefault(term, {})[parameter] = shared[index]
    return values


def _push(amplitude: Any, edges_s: Any, speed_m_s: Any, time_s: Any, velocity: Vec) -> Vec:
    """Extra acceleration of the ball at a moment of its flight."""
    band = jnp.arange(len(edges_s) + 1) == jnp.searchsorted(edges_s, time_s)
    speed = jnp.sqrt(velocity.x**2 + velocity.y**2 + velocity.z**2 + 1e-12)
    shape = jnp.concatenate([jnp.ones(1), band.astype(float), jnp.array([speed / speed_m_s])])
    size = amplitude @ shape
    along, up, left = axes(velocity)
    return Vec(*(size[0] * a + size[1] * u + size[2] * b for a, u, b in zip(along, up, left, strict=True)))


def _fly_through(law: Law, release: Release, time_s: Any, substeps: int,
                 push: Callable[[Any, Vec], Vec] | None = None) -> tuple[Any, Any]:
    spin = Vec(*release.spin_rev_s)

    def advance(ball: BallState, span: tuple[Any, Any]) -> tuple[BallState, tuple[Any, Any]]:
        start_s, length_s = span
        step_s = length_s / substeps

        def step(ball: BallState, part: Any) -> tuple[BallState, None]:
            middle_s = start_s + (part + 0.5) * step_s
            full = law if push is None else lambda b: add(law(b), push(middle_s, b.velocity_m_s))
            return rk4(full, ball, step_s), None

        ball, _ = lax.scan(step, ball, jnp.arange(substeps))
        return ball, (jnp.stack(ball.position_m), jnp.stack(ball.velocity_m_s))

    first = BallState(Vec(*release.position_m), Vec(*release.velocity_m_s), spin, jnp.zeros(()))
    spans = (time_s[:-1], jnp.diff(time_s))
    _, (positions, velocities) = lax.scan(advance, first, spans)
    return (jnp.concatenate([release.position_m[None], positions]),
            jnp.concatenate([release.velocity_m_s[None], velocities]))


def _one_height(believed: Believed, launch: Any, spin_rev_s: Any, distance_m: Any, shared: Any) -> tuple[Any, Any]:
    law = make_law(believed.facts, believed.terms, _values(believed, shared))
    speed, elevation, height_m, farther_m, push_along, push_up = (*jnp.split(launch, 6),)
    speed, elevation = jnp.exp(speed[0]), elevation[0]
    step_m = (distance_m + farther_m[0]) / PLANE_STEPS

    def slope(state: Any) -> Any:
        """d(y, z, vx, vy, vz, t)/dx."""
        velocity = Vec(jnp.maximum(state[2], SLOWEST_M_S), state[3], state[4])
        ball = BallState(Vec(0.0 * state[0], state[0], state[1]), velocity, Vec(*spin_rev_s), state[5])
        along, up, _ = axes(velocity)
        force = [f + push_along[0] * a + push_up[0] * u for f, a, u in zip(law(ball), along, up, strict=True)]
        return jnp.stack([velocity.y, velocity.z, *force, jnp.ones(())]) / velocity.x

    def advance(carry: tuple[Any, Any], _: None) -> tuple[tuple[Any, Any], None]:
        state, near = carry
        k1 = slope(state)
        k2 = slope(state + 0.5 * step_m * k1)
        k3 = slope(state + 0.5 * step_m * k2)
        k4 = slope(state + step_m * k3)
        new = state + step_m / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        near = near & (new[2] > SLOWEST_M_S) & (new[1] > LOWEST_M) & jnp.all(jnp.isfinite(new))
        return (jnp.where(near, new, state), near), None

    zero = jnp.zeros_like(speed)
    start = jnp.stack([zero, height_m[0], speed * jnp.cos(elevation), zero, speed * jnp.sin(elevation), zero])
    (end, near), _ = lax.scan(advance, (start, start[2] > SLOWEST_M_S), None, length=PLANE_STEPS)
    return end[1], near
