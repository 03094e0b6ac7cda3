"""The flight over x instead of time: the height at a plane as a smooth function, in few steps of fixed number.

The same law of motion as truearc.sim.physics.flight, which it is tested against; for likelihoods, whose second
derivatives it keeps cheap. Through the floor if need be; only a ball that has nearly turned back has no height.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.flight import Law, full, kept, needs_time, settle, start_of
from truearc.sim.physics.launch import Exit
from truearc.sim.physics.term import BallState
from truearc.sim.physics.vector import Vec, absent, plus, scale

STEPS = 32                            # of 3000 random launches 99 % within 6e-6 m at cd 0.5, 1e-3 m at cd 1.2
AHEAD = (0.5, 0.5, 1.0, 0.0)          # where the next stage of a Runge-Kutta step is taken
SHARE = (1 / 6, 1 / 3, 1 / 3, 1 / 6)  # of each stage in the step
SLOWEST_M_S = 0.3                     # horizontally; slower has nearly turned back


class Plane(NamedTuple):
    """At the plane, arrays [n]: height, how fast the ball climbs per metre of x, whether it came there at all, how far
    to the left it is, and how long it has flown, where that was asked for."""

    height_m: Any
    climb: Any
    near: Any
    side_m: Any
    flown_s: Any = None


def reach_plane(rig: Rig, law: Law, exit: Exit, distance_m: Any, steps: int = STEPS, timed: bool = False) -> Plane:
    """Fly every lane [n] from the exit to x = distance_m by Runge-Kutta over x; differentiable in all, to any order.

    Where `near` is False the numbers have no meaning. timed: count the time of flight, too.
    """
    shape = jnp.shape(distance_m)
    ball, zero = settle(law, start_of(rig, exit, shape)), jnp.zeros(shape)
    if timed or needs_time(law, ball):
        ball = ball._replace(time_s=zero)
    step_m = distance_m / steps
    near = (ball.velocity_m_s.x > SLOWEST_M_S) & (step_m > 0.0)

    def advance(carry: Any, _: None) -> tuple[Any, None]:
        state, near = carry
        new, slowest_m_s = _step(law, ball, state, step_m)
        near = near & (jnp.minimum(slowest_m_s, full(ball, new).velocity_m_s.x) > SLOWEST_M_S)
        return (new, near), None

    state, near = lax.scan(advance, (kept(ball), near), None, length=steps)[0]
    end = full(ball, state)
    return Plane(end.position_m.z, end.velocity_m_s.z / _pace(end.velocity_m_s.x), near, plus(end.position_m.y, zero),
                 end.time_s if timed else None)


def _pace(speed_m_s: Any) -> Any:
    return jnp.maximum(speed_m_s, SLOWEST_M_S)


def _step(law: Law, like: BallState, start: tuple[Any, ...], step_m: Any) -> tuple[tuple[Any, ...], Any]:
    """One classical Runge-Kutta step of d(position, velocity, time)/dx = (v, a, 1) / vx; and the least vx on its way.

    The four stages are a loop of their own: derivatives of derivatives compile in a third of the time.
    """
    def stage(carry: Any, weights: Any) -> tuple[Any, None]:
        state, total, slowest_m_s = carry
        here = full(like, state)
        rate = _rate(law, here)
        total = jax.tree.map(lambda sum_, part: sum_ + weights[1] * part, total, rate)
        moved = jax.tree.map(lambda begin, part: begin + weights[0] * step_m * part, start, rate)
        return (moved, total, jnp.minimum(slowest_m_s, here.velocity_m_s.x)), None

    zero = jax.tree.map(jnp.zeros_like, start)
    weights = (jnp.array(AHEAD), jnp.array(SHARE))
    first = (start, zero, full(like, start).velocity_m_s.x)
    _, total, slowest_m_s = lax.scan(stage, first, weights)[0]
    return jax.tree.map(lambda begin, part: begin + step_m * part, start, total), slowest_m_s


def _rate(law: Law, ball: BallState) -> tuple[Any, ...]:
    per_m = 1.0 / _pace(ball.velocity_m_s.x)
    pushed = Vec(*(part if absent(speed) else plus(part, jnp.zeros_like(speed))      # wherever the velocity has one
                   for part, speed in zip(law(ball), ball.velocity_m_s, strict=True)))
    return kept(BallState(scale(per_m, ball.velocity_m_s), scale(per_m, pushed), ball.spin_rev_s,
                          ball.time_s if absent(ball.time_s) else per_m))
