"""The flight of the ball to a vertical plane, following Eqs. 4-10 of the paper, integrated over time or over x.

`fly` integrates over time. The ball reaches the plane if the point mass crosses x = distance for the first time before
it hits the floor (z = 0) and before it turns back (vx <= 0). docs/how-to/paper.md explains this choice.

`reach_plane` integrates the same law over x for likelihoods: the height at the plane is a smooth function, computed in
a small fixed number of steps, with cheap second derivatives. The flight continues through the floor; only a ball that
has nearly turned back has no height.

`apart` separates a rig's numbers from the compiled code, so that one compilation serves all rigs.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache, partial
from itertools import repeat
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import msgspec
import numpy as np
from jax import lax

from truearc.robot.config.rig_spec import Ball, Rig
from truearc.sim.physics import term as kinds
from truearc.sim.physics.term import BallState, Exit, InFlight, Vec, absent, add, complete, length, plus, scale, times

STEP_S = 0.002                        # longest RK4 step: heights of 30 000 random launches within 6e-9 m of DOP853
TURN_RAD = 0.02                       # ... and the air changes the velocity by no more than this share in one
LIMIT_S = 60.0                        # a ball still aloft then has not reached
SHORTEST = 1.0 / 256.0                # of step_s, whatever the air does
NEWTON_STEPS = 6
STEPS = 32                            # over x: of 3000 random launches 99 % within 6e-6 m at cd 0.5, 1e-3 m at cd 1.2
AHEAD = (0.5, 0.5, 1.0, 0.0)          # where the next stage of a Runge-Kutta step is taken
SHARE = (1 / 6, 1 / 3, 1 / 3, 1 / 6)  # of each stage in the step
SLOWEST_M_S = 0.3                     # horizontally; slower has nearly turned back

Law = Callable[[BallState], Vec]
Balls = tuple[Any, Any]               # mass in kg, radius in m of each lane's ball


class Crossing(NamedTuple):
    """Arrival at the target plane; height is nan if not reached, and time then is the end of the flight."""

    height_m: Any
    time_s: Any
    reached: Any


class _Flight(NamedTuple):
    """Loop state: each lane stops at the last step before whatever ends its flight."""

    steps: Any
    flying: Any
    time_s: Any
    ball: Any                         # in the loop what `kept` keeps of it, then a BallState


def fly(rig: Rig, terms: tuple[InFlight, ...], params: Mapping[str, Mapping[str, Any]], exit: Exit,
        distance_m: Any, step_s: float = STEP_S, turn_rad: float = TURN_RAD, limit_s: float = LIMIT_S,
        balls: Balls | None = None) -> Crossing:
    """Fly every lane to the plane x = distance_m; balls: (mass in kg, radius in m) of each, the rig's when None.

    params: {term: {parameter: value}}, effective; they, exit and distance_m broadcast against each other, and the
    result has that shape. Fixed-step RK4 in float64; each lane's step is at most step_s, and so short that the air
    turns or slows the velocity by at most turn_rad in the first one; the crossing is solved on a part of the last step.
    Forward-mode differentiable (jax.jacfwd) in params, exit and distance.
    """
    flown: Crossing = _fly(*apart(rig), terms, params, exit, distance_m, balls, step_s, turn_rad, limit_s)
    return flown


@partial(jax.jit, static_argnames=("shape_of_rig", "terms", "step_s", "turn_rad", "limit_s"))
def _fly(shape_of_rig: Rig, numbers: Any, terms: tuple[InFlight, ...],
         params: Mapping[str, Mapping[str, Any]], exit: Exit, distance_m: Any, balls: Balls | None, step_s: float,
         turn_rad: float, limit_s: float) -> Crossing:
    rig = together(shape_of_rig, numbers)
    law = make_law(with_balls(rig, balls), terms, params)
    shape = _shape(params, exit, distance_m)
    distance = jnp.broadcast_to(jnp.asarray(distance_m, dtype=float), shape)
    start = settle(law, start_of(rig, exit, shape))
    step = _step_for(law, start, step_s, turn_rad)
    end = _fly_until(law, start, step, distance, math.ceil(limit_s / (step_s * SHORTEST)), limit_s)
    return _cross(law, end, step, distance)


@partial(jax.jit, static_argnames=("rig", "terms", "points", "step_s"))
def path(rig: Rig, terms: tuple[InFlight, ...], params: Mapping[str, Mapping[str, Any]], exit: Exit,
         points: int, step_s: float = STEP_S) -> BallState:
    """Return the free flight of every lane, `points` states step_s apart (leading axis, launch first), through the
    floor."""
    law = make_law(rig, terms, params)
    start = _dense(start_of(rig, exit, _shape(params, exit, 0.0)))

    def advance(ball: BallState, _: None) -> tuple[BallState, BallState]:
        return _dense(rk4(law, ball, step_s)), ball

    return lax.scan(advance, start, None, length=points)[1]


def with_balls(rig: Rig, balls: Balls | None) -> Rig:
    """Return the rig with the balls' arrays in place of its own ball."""
    return rig if balls is None else msgspec.structs.replace(rig, ball=Ball(*balls))


def make_law(rig: Rig, terms: Sequence[InFlight], params: Mapping[str, Mapping[str, Any]]) -> Law:
    """Return the sum of the terms' accelerations in m/s2 as a function of the ball's state.

    terms: in the catalogue's order. params: effective values (truearc.sim.physics.catalogue.effective). First the
    terms about the air make the ball as the air sees it; then each force in turn may be a share of those before it.
    """
    airs = [(term, complete(term, params.get(term.name))) for term in terms if isinstance(term, kinds.AirTerm)]
    pushes = [(term, complete(term, params.get(term.name))) for term in terms if isinstance(term, kinds.FlightTerm)]

    def law(ball: BallState) -> Vec:
        for air, values in airs:
            ball = air.meet(rig, values, ball)
        total = Vec(0.0, 0.0, 0.0)
        forces: dict[str, Vec] = {}
        for term, values in pushes:
            forces[term.name] = term.acceleration(rig, values, ball, forces)
            total = add(total, forces[term.name])
        return total

    return law


def needs_time(law: Law, ball: BallState) -> bool:
    """Return whether the equation of motion depends on the time of flight; found by tracing it."""
    traced = jax.make_jaxpr(lambda time_s: tuple(law(ball._replace(time_s=time_s))))(0.0).jaxpr
    return any(atom is traced.invars[0] for equation in traced.eqns for atom in equation.invars)


def start_of(rig: Rig, exit: Exit, shape: tuple[int, ...]) -> BallState:
    """Return the ball at the exit point, flying in the vertical plane, with backspin about -y."""
    speed, elevation, spin, above_m = (jnp.broadcast_to(jnp.asarray(part, dtype=float), shape) for part in exit)
    zero = jnp.zeros(shape)
    return BallState(position_m=Vec(zero, 0.0, zero + rig.launcher.release_height_m + above_m),
                     velocity_m_s=Vec(speed * jnp.cos(elevation), 0.0, speed * jnp.sin(elevation)),
                     spin_rev_s=Vec(0.0, -spin, 0.0))


def rk4(law: Law, ball: BallState, step_s: Any) -> BallState:
    """Make one classical Runge-Kutta step of position, velocity and time; step_s: a number or one per lane."""
    half = times(0.5, step_s)
    v1 = ball.velocity_m_s
    a1 = law(ball)
    v2, a2 = _slope(law, ball, v1, a1, half)
    v3, a3 = _slope(law, ball, v2, a2, half)
    v4, a4 = _slope(law, ball, v3, a3, step_s)
    return ball._replace(position_m=add(ball.position_m, scale(step_s / 6.0, _weigh(v1, v2, v3, v4))),
                         velocity_m_s=add(ball.velocity_m_s, scale(step_s / 6.0, _weigh(a1, a2, a3, a4))),
                         time_s=plus(ball.time_s, step_s))


def _slope(law: Law, ball: BallState, velocity: Vec, acceleration: Vec, step_s: Any) -> tuple[Vec, Vec]:
    moved = ball._replace(position_m=add(ball.position_m, scale(step_s, velocity)),
                          velocity_m_s=add(ball.velocity_m_s, scale(step_s, acceleration)),
                          time_s=plus(ball.time_s, step_s))
    return moved.velocity_m_s, law(moved)


def _weigh(k1: Vec, k2: Vec, k3: Vec, k4: Vec) -> Vec:
    return add(add(k1, k4), scale(2.0, add(k2, k3)))


def settle(law: Law, ball: BallState) -> BallState:
    """Replace absent sideways components by arrays if the law pushes sideways, so that the loop's state keeps its
    form."""
    if absent(law(ball).y) and absent(ball.velocity_m_s.y):
        return ball
    return _dense(ball)._replace(time_s=ball.time_s)


def _dense(ball: BallState) -> BallState:
    zero = jnp.zeros_like(ball.position_m.x)
    place, velocity, spin = (Vec(*(plus(part, zero) for part in vec)) for vec in ball[:3])
    return BallState(place, velocity, spin, plus(ball.time_s, zero))


def _step_for(law: Law, start: BallState, step_s: float, turn_rad: float) -> Any:
    """Each lane's step: short where the air changes the velocity fast; no derivative is taken through it.

    What acts on a ball at rest, such as weight, does not count: Runge-Kutta is exact for it.
    """
    at_rest = law(start._replace(velocity_m_s=scale(0.0 * start.position_m.x, start.velocity_m_s)))
    per_s = length(add(law(start), scale(-1.0, at_rest))) / length(start.velocity_m_s)
    return lax.stop_gradient(jnp.clip(turn_rad / per_s, step_s * SHORTEST, step_s))


def _fly_until(law: Law, start: BallState, step: Any, distance: Any, most_steps: int, limit_s: float) -> _Flight:
    def go_on(flight: _Flight) -> Any:
        return jnp.any(flight.flying) & (flight.steps < most_steps)

    def advance(flight: _Flight) -> _Flight:
        old = full(start, flight.ball)._replace(time_s=flight.time_s)
        new = rk4(law, old, step)
        moves = flight.flying & ~_ends(old, new, step, distance) & (flight.time_s < limit_s)
        ball = jax.tree.map(lambda a, b: jnp.where(moves, b, a), flight.ball, kept(new._replace(time_s=0.0)))
        return _Flight(flight.steps + 1, moves, flight.time_s + jnp.where(moves, step, 0.0), ball)

    flying = (start.velocity_m_s.x > 0.0) & (start.position_m.x < distance)
    end = lax.while_loop(go_on, advance, _Flight(0, flying, jnp.zeros_like(step), kept(start)))
    return end._replace(ball=full(start, end.ball)._replace(time_s=end.time_s))


def kept(ball: BallState) -> tuple[Any, ...]:
    """Return the state of a flight for JAX's loops: the components of position and velocity, and the time, that are
    present."""
    return tuple(part for part in (*ball.position_m, *ball.velocity_m_s, ball.time_s) if not absent(part))


def full(like: BallState, state: tuple[Any, ...]) -> BallState:
    """Invert kept, for a flight with the components of `like`."""
    rest = iter(state)
    place, velocity = (Vec(*(part if absent(part) else next(rest) for part in vec)) for vec in like[:2])
    return like._replace(position_m=place, velocity_m_s=velocity,
                         time_s=like.time_s if absent(like.time_s) else next(rest))


def _ends(old: BallState, new: BallState, step: Any, distance: Any) -> Any:
    """Whether a step crosses the plane, turns back, or meets the floor."""
    return (new.position_m.x >= distance) | (new.velocity_m_s.x <= 0.0) | (_lowest_m(old, new, step) < 0.0)


def _lowest_m(old: BallState, new: BallState, step: Any) -> Any:
    """Lowest height within a step, by the parabola through height and vertical speeds at its ends."""
    v0, v1 = old.velocity_m_s.z, new.velocity_m_s.z
    dips = (v0 < 0.0) & (v1 > 0.0)
    dip_m = 0.5 * v0 * v0 * step / jnp.where(dips, v1 - v0, 1.0)
    return jnp.minimum(new.position_m.z, jnp.where(dips, old.position_m.z - dip_m, old.position_m.z))


def _cross(law: Law, end: _Flight, step: Any, distance: Any) -> Crossing:
    """Where each flight's last step crosses the plane, if it does; solved only if some lane comes near enough."""
    ball = end.ball
    gap_m = distance - ball.position_m.x
    fastest_m_s = jnp.maximum(ball.velocity_m_s.x, rk4(law, ball, step).velocity_m_s.x)
    near = jnp.any(gap_m <= 2.0 * step * fastest_m_s)
    nowhere = jnp.full_like(end.time_s, jnp.nan)
    height_m, time_s = lax.cond(near, lambda: _solve(law, end, step, distance), lambda: (nowhere, end.time_s))
    return Crossing(height_m, time_s, ~jnp.isnan(height_m))


def _solve(law: Law, end: _Flight, step: Any, distance: Any) -> tuple[Any, Any]:
    """(height_m or nan, time_s) at x = distance within the step that ended each flight, by Newton on a part of it."""
    ball = end.ball
    turn_s = _turning_time(law, ball, step)
    gap_m = distance - ball.position_m.x
    reached = (rk4(law, ball, turn_s).position_m.x >= distance) | (gap_m <= 0.0)
    part_s = _first_root(gap_m, ball.velocity_m_s.x, law(ball).x, turn_s)

    def improve(part_s: Any, _: None) -> tuple[Any, None]:
        there = rk4(law, ball, part_s)
        speed = jnp.where(there.velocity_m_s.x > 0.0, there.velocity_m_s.x, jnp.inf)
        return jnp.clip(part_s - (there.position_m.x - distance) / speed, 0.0, turn_s), None

    part_s = lax.scan(improve, part_s, None, length=NEWTON_STEPS)[0]
    there = rk4(law, ball, part_s)
    reached = reached & (_lowest_m(ball, there, part_s) >= 0.0)
    return jnp.where(reached, there.position_m.z, jnp.nan), end.time_s + jnp.where(reached, part_s, 0.0)


def _turning_time(law: Law, ball: BallState, step: Any) -> Any:
    """The part of the last step for which vx > 0."""
    def improve(part_s: Any, _: None) -> tuple[Any, None]:
        there = rk4(law, ball, part_s)
        slope = law(there).x
        return jnp.clip(part_s - there.velocity_m_s.x / jnp.where(slope < 0.0, slope, -jnp.inf), 0.0, step), None

    back = rk4(law, ball, step).velocity_m_s.x <= 0.0
    return jnp.where(back, lax.scan(improve, step, None, length=NEWTON_STEPS)[0], step)


def _first_root(gap_m: Any, speed_m_s: Any, acceleration_m_s2: Any, longest_s: Any) -> Any:
    """Earlier root of speed t + acceleration t^2 / 2 = gap in [0, longest_s]; right for tangent crossings too."""
    under = jnp.maximum(speed_m_s**2 + 2.0 * acceleration_m_s2 * gap_m, 0.0)
    divisor = speed_m_s + jnp.sqrt(jnp.where(under > 0.0, under, 1.0)) * (under > 0.0)
    return jnp.clip(2.0 * gap_m / jnp.where(divisor > 0.0, divisor, jnp.inf), 0.0, longest_s)


def _shape(params: Mapping[str, Mapping[str, Any]], exit: Exit, distance_m: Any) -> tuple[int, ...]:
    return jnp.broadcast_shapes(*(jnp.shape(leaf) for leaf in jax.tree.leaves((params, tuple(exit), distance_m))))


class Plane(NamedTuple):
    """Arrival at the plane, arrays [n]: height, climb per metre of x, whether the ball reached it, lateral position to
    the left, and time of flight if requested."""

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
    _, total, slowest_m_s = lax.scan(stage, (start, zero, full(like, start).velocity_m_s.x), weights)[0]
    return jax.tree.map(lambda begin, part: begin + step_m * part, start, total), slowest_m_s


def _rate(law: Law, ball: BallState) -> tuple[Any, ...]:
    per_m = 1.0 / _pace(ball.velocity_m_s.x)
    pushed = Vec(*(part if absent(speed) else plus(part, jnp.zeros_like(speed))      # wherever the velocity has one
                   for part, speed in zip(law(ball), ball.velocity_m_s, strict=True)))
    return kept(BallState(scale(per_m, ball.velocity_m_s), scale(per_m, pushed), ball.spin_rev_s,
                          ball.time_s if absent(ball.time_s) else per_m))


@lru_cache(256)
def apart(rig: Rig) -> tuple[Rig, np.ndarray]:
    """Return the rig without its numbers, for which code is compiled, and these [numbers], in the order of its
    fields."""
    return _put(rig, repeat(0.0)), np.array(list(_leaves(rig)), dtype=float)


def together(rig: Rig, numbers: Any) -> Rig:
    """Return the rig of both; numbers may be traced."""
    whole: Rig = _put(rig, iter([numbers[k] for k in range(len(numbers))]))
    return whole


def _leaves(part: Any) -> Iterator[float]:
    if isinstance(part, float):
        yield part
    elif isinstance(part, msgspec.Struct | tuple):
        for inner in part if isinstance(part, tuple) else msgspec.structs.astuple(part):
            yield from _leaves(inner)


def _put(part: Any, numbers: Iterator[Any]) -> Any:
    if isinstance(part, float):
        return next(numbers)
    if isinstance(part, tuple):
        return tuple(_put(inner, numbers) for inner in part)
    if isinstance(part, msgspec.Struct):
        return type(part)(*(_put(inner, numbers) for inner in msgspec.structs.astuple(part)))
    return part
