"""The flight over x instead of time: the height at a plane as a smooth function, in few steps of fixed number.

The same law of motion as sim.physics.flight, which it is tested against; for likelihoods, whose second derivatives it
keeps cheap. Through the floor if need be; only a ball that has as good as turned back has no height.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from robot.facts import Facts
from sim.physics.flight import Law, start_of
from sim.physics.launch import Exit
from sim.physics.term import BallState
from sim.physics.vector import Vec, absent, plus, scale

STEPS = 32                            # of 3000 random launches 99 % within 6e-6 m at cd 0.5, 1e-3 m at cd 1.2
AHEAD = (0.5, 0.5, 1.0, 0.0)          # where the next stage of a Runge-Kutta step is taken
SHARE = (1 / 6, 1 / 3, 1 / 3, 1 / 6)  # of each stage in the step
SLOWEST_M_S = 0.3                     # horizontally; slower has as good as turned back


class Plane(NamedTuple):
    """At the plane, arrays [n]: height, how fast the ball climbs per metre of x, and whether it came there at all."""

    height_m: Any
    climb: Any
    near: Any


def reach_plane(facts: Facts, law: Law, exit: Exit, distance_m: Any, steps: int = STEPS) -> Plane:
    """Fly every lane [n] from the exit to x = distance_m by Runge-Kutta over x; differentiable in all, to any order.

    Where `near` is False height and climb are numbers without meaning.
    """
    shape = jnp.shape(distance_m)
    ball = start_of(facts, exit, shape)
    if not absent(law(ball).y):
        zero = jnp.zeros(shape)
        ball = BallState(*(Vec(*(plus(part, zero) for part in vec)) for vec in ball))
    step_m = distance_m / steps
    near = (ball.velocity_m_s.x > SLOWEST_M_S) & (step_m > 0.0)
    flat = absent(ball.position_m.y)

    def advance(carry: Any, _: None) -> tuple[Any, None]:
        place, velocity, near = carry
        old = ball._replace(position_m=_full(place, flat), velocity_m_s=_full(velocity, flat))
        new, slowest_m_s = _step(law, old, step_m, flat)
        near = near & (jnp.minimum(slowest_m_s, new.velocity_m_s.x) > SLOWEST_M_S)
        return (_kept(new.position_m, flat), _kept(new.velocity_m_s, flat), near), None

    start = (_kept(ball.position_m, flat), _kept(ball.velocity_m_s, flat), near)
    place, velocity, near = lax.scan(advance, start, None, length=steps)[0]
    return Plane(place[-1], velocity[-1] / _pace(velocity[0]), near)


def _kept(vec: Vec, flat: bool) -> tuple[Any, ...]:
    return (vec.x, vec.z) if flat else (vec.x, vec.y, vec.z)


def _full(kept: tuple[Any, ...], flat: bool) -> Vec:
    return Vec(kept[0], 0.0, kept[1]) if flat else Vec(*kept)


def _pace(speed_m_s: Any) -> Any:
    return jnp.maximum(speed_m_s, SLOWEST_M_S)


def _step(law: Law, ball: BallState, step_m: Any, flat: bool) -> tuple[BallState, Any]:
    """One classical Runge-Kutta step of d(position, velocity)/dx = (v, a) / vx, and the least vx of its stages.

    The four stages are a loop of their own: derivatives of derivatives compile in a third of the time.
    """
    start = (_kept(ball.position_m, flat), _kept(ball.velocity_m_s, flat))

    def stage(carry: Any, weights: Any) -> tuple[Any, None]:
        place, velocity, total, slowest_m_s = carry
        here = ball._replace(position_m=_full(place, flat), velocity_m_s=_full(velocity, flat))
        rate = tuple(_kept(part, flat) for part in _rate(law, here))
        total = jax.tree.map(lambda sum_, part: sum_ + weights[1] * part, total, rate)
        moved = jax.tree.map(lambda begin, part: begin + weights[0] * step_m * part, start, rate)
        return (*moved, total, jnp.minimum(slowest_m_s, velocity[0])), None

    zero = jax.tree.map(jnp.zeros_like, start)
    weights = (jnp.array(AHEAD), jnp.array(SHARE))
    _, _, total, slowest_m_s = lax.scan(stage, (*start, zero, ball.velocity_m_s.x), weights)[0]
    place, velocity = jax.tree.map(lambda begin, part: begin + step_m * part, start, total)
    return ball._replace(position_m=_full(place, flat), velocity_m_s=_full(velocity, flat)), slowest_m_s


def _rate(law: Law, ball: BallState) -> tuple[Vec, ...]:
    per_m = 1.0 / _pace(ball.velocity_m_s.x)
    return scale(per_m, ball.velocity_m_s), scale(per_m, law(ball))
