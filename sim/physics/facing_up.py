"""Openings that face up: where the ball comes down through the plane of the rim, and whether it goes in.

The plane goes through the opening's centre; the plane's normal leans back by target.tilt_deg about the lateral axis. A
landing is the last downward passage of the ball's centre through the plane. It is given relative to the opening's
centre: along (away from the launcher), across (to the left), and the angle of arrival below the plane. A ball that
meets the backboard above the rim bounces. It keeps the share `bounce` of its speed into the board, and friction stops
the slip of its surface, as for a solid ball that grips (Garwin 1969; Cross 2002). Whether the ball goes in depends on
its size. Its path near the rim is taken as a straight line, and it clears the near edge if (along + half) sin(angle) >=
radius. At the other edges its centre must be inside, since a ball that touches the inner wall below the rim usually
goes in. docs/reference/dataset.md describes the keys.
"""

import math
from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from msgspec import UnsetType

from truearc.robot.config.rig_spec import Rig, Target
from truearc.sim.physics import flight
from truearc.sim.physics.flight import LIMIT_S, NEWTON_STEPS, SHORTEST, STEP_S, TURN_RAD, Balls, Law, rk4
from truearc.sim.physics.term import BallState, Exit, InFlight, Opening, Vec

GRIP = 2.0 / 7.0                      # of the slip that leaves the velocity; a solid sphere's, source: Garwin 1969
SPUN = 5.0 / 2.0                      # of it that turns the ball, as a rim speed: mass times radius over inertia


class Landing(NamedTuple):
    """Where balls come down through the plane, arrays [n]; nan where one never does.

    rise_m: along, where it came up through the plane before; -inf if it was released above. angle_rad: from the plane,
    in the direction along; of a ball that comes back from a backboard more than a right angle.
    """

    along_m: Any
    across_m: Any
    angle_rad: Any
    time_s: Any
    rise_m: Any
    bounced: Any

    @property
    def reached(self) -> Any:
        """Whether it came down through the plane at all."""
        return ~np.isnan(self.along_m)


class Plane(NamedTuple):
    """The plane of the rim: distance and height of its centre in m, and sine and cosine of its tilt."""

    distance_m: Any
    height_m: Any
    sine: Any
    cosine: Any

    @classmethod
    def of(cls, target: Target, distance_m: Any, height_m: Any) -> "Plane":
        tilt = 0.0 if isinstance(target.tilt_deg, UnsetType) else target.tilt_deg * (math.pi / 180.0)
        return cls(distance_m, height_m, jnp.sin(tilt), jnp.cos(tilt))

    def above(self, x_m: Any, z_m: Any) -> Any:
        """Return how far above the plane a place is, or a velocity goes away from it (without the centre's place)."""
        return z_m * self.cosine - x_m * self.sine

    def along(self, x_m: Any, z_m: Any) -> Any:
        """Return the same along the plane."""
        return x_m * self.cosine + z_m * self.sine

    def apart(self, place: Vec) -> Any:
        """Return how far above the plane the ball's centre is."""
        return self.above(place.x - self.distance_m, place.z - self.height_m)


class _Trip(NamedTuple):
    """Loop state: the ball, and the last states before it rose through the plane, fell through it, met the board."""

    steps: Any
    flying: Any
    ball: Any
    rose: Any
    fell: Any
    met: Any
    seen: Any                         # which of the three there were


def land(rig: Rig, terms: tuple[InFlight, ...], params: Mapping[str, Mapping[str, Any]], exit: Exit, distance_m: Any,
         opening: Opening, step_s: float = STEP_S, balls: Balls | None = None) -> Landing:
    """Fly every lane [n] down to the plane of the rig's target, as flight.fly does to an upright one.

    opening: its centre's height and the board's bounce. Forward-mode differentiable in params, exit, distance, opening.
    """
    shape, numbers = flight.apart(rig)
    landing: Landing = _land(shape, numbers, terms, params, exit, distance_m, opening, balls, step_s)
    return landing


@partial(jax.jit, static_argnames=("shape_of_rig", "terms", "step_s"))
def _land(shape_of_rig: Rig, numbers: Any, terms: tuple[InFlight, ...], params: Mapping[str, Mapping[str, Any]],
          exit: Exit, distance_m: Any, opening: Opening, balls: Balls | None, step_s: float) -> Landing:
    rig = flight.with_balls(flight.together(shape_of_rig, numbers), balls)
    target = rig.target
    assert target is not None
    law = flight.make_law(rig, terms, params)
    distance_m = jnp.asarray(distance_m, dtype=float)
    plane = Plane.of(target, distance_m, opening.centre_m)
    ball = flight._dense(flight.start_of(rig, exit, distance_m.shape))
    step = flight._step_for(law, ball, step_s, TURN_RAD)
    board = target.backboard
    if isinstance(board, UnsetType):
        trip = _fly_down(law, ball, step, plane, jnp.inf)
        return _landing(law, trip, step, plane)
    wall_m = distance_m + board.behind_m - rig.ball.radius_m
    trip = _fly_down(law, ball, step, plane, wall_m)
    there = _at(law, trip.met, step, lambda one: one.position_m.x - wall_m, lambda one: one.velocity_m_s.x)
    above_m = plane.apart(there.position_m)
    bounced = trip.seen[2] & (above_m >= 0.0) & (above_m <= board.height_m * plane.cosine)
    first = _landing(law, trip, step, plane)
    again = _landing(law, _fly_down(law, bounce(there, rig.ball.radius_m, opening.bounce), step, plane, jnp.inf), step,
                     plane)
    merged = Landing(*(jnp.where(bounced, b, a) for a, b in zip(first, again, strict=True)))
    return merged._replace(rise_m=first.rise_m, bounced=bounced & ~jnp.isnan(again.along_m))


def bounce(ball: BallState, radius_m: Any, share: Any) -> BallState:
    """Return the ball as it leaves an upright board behind the target."""
    velocity, spin_rad_s = ball.velocity_m_s, Vec(*(2.0 * math.pi * part for part in ball.spin_rev_s))
    left_m_s = GRIP * (velocity.y + radius_m * spin_rad_s.z)
    up_m_s = GRIP * (velocity.z - radius_m * spin_rad_s.y)
    turned = Vec(spin_rad_s.x, spin_rad_s.y + SPUN * up_m_s / radius_m, spin_rad_s.z - SPUN * left_m_s / radius_m)
    return ball._replace(velocity_m_s=Vec(-share * velocity.x, velocity.y - left_m_s, velocity.z - up_m_s),
                         spin_rev_s=Vec(*(part / (2.0 * math.pi) for part in turned)))


def _fly_down(law: Law, start: BallState, step: Any, plane: Plane, wall_m: Any) -> _Trip:
    """Fly to the floor."""
    def advance(trip: _Trip) -> _Trip:
        old = trip.ball
        new = rk4(law, old, step)
        before_m, after_m = plane.apart(old.position_m), plane.apart(new.position_m)
        events = ((before_m < 0.0) & (after_m >= 0.0), (before_m >= 0.0) & (after_m < 0.0),
                  (old.position_m.x < wall_m) & (new.position_m.x >= wall_m) & ~trip.seen[2])
        now = [trip.flying & event for event in events]
        kept = [jax.tree.map(lambda a, b, at=at: jnp.where(at, b, a), state, old)
                for at, state in zip(now, trip[3:6], strict=True)]
        goes_on = trip.flying & (flight._lowest_m(old, new, step) >= 0.0) & (new.time_s < LIMIT_S)
        ball = jax.tree.map(lambda a, b: jnp.where(goes_on, b, a), old, new)
        seen = tuple(had | at for had, at in zip(trip.seen, now, strict=True))
        rose, fell, met = kept
        return _Trip(trip.steps + 1, goes_on, ball, rose, fell, met, seen)

    most = math.ceil(LIMIT_S / (STEP_S * SHORTEST))
    never = jnp.zeros(jnp.shape(start.position_m.x), dtype=bool)
    begin = _Trip(0, ~never, start, start, start, start, (never, never, never))
    return lax.while_loop(lambda trip: jnp.any(trip.flying) & (trip.steps < most), advance, begin)


def _at(law: Law, ball: BallState, step: Any, value: Any, rate: Any) -> BallState:
    """The ball where `value` of it is 0, within the step after `ball`; by Newton from the straight line."""
    begin, end = value(ball), value(rk4(law, ball, step))
    part_s = step * jnp.clip(begin / jnp.where(begin == end, jnp.inf, begin - end), 0.0, 1.0)

    def improve(part_s: Any, _: None) -> tuple[Any, None]:
        there = rk4(law, ball, part_s)
        slope = rate(there)
        return jnp.clip(part_s - value(there) / jnp.where(slope == 0.0, jnp.inf, slope), 0.0, step), None

    return rk4(law, ball, lax.scan(improve, part_s, None, length=NEWTON_STEPS)[0])


def _landing(law: Law, trip: _Trip, step: Any, plane: Plane) -> Landing:
    def apart(ball: BallState) -> Any:
        return plane.apart(ball.position_m)

    def leaves(ball: BallState) -> Any:
        return plane.above(ball.velocity_m_s.x, ball.velocity_m_s.z)

    there, rose = _at(law, trip.fell, step, apart, leaves), _at(law, trip.rose, step, apart, leaves)
    place, velocity = there.position_m, there.velocity_m_s
    angle = jnp.arctan2(-leaves(there), plane.along(velocity.x, velocity.z))

    def along(ball: BallState) -> Any:
        return plane.along(ball.position_m.x - plane.distance_m, ball.position_m.z - plane.height_m)

    along_m, across_m, angle_rad, time_s = (jnp.where(trip.seen[1], one, jnp.nan)
                                            for one in (along(there), place.y, angle, there.time_s))
    return Landing(along_m, across_m, angle_rad, time_s, jnp.where(trip.seen[0], along(rose), -jnp.inf),
                   jnp.zeros_like(trip.seen[0]))


def half_along(target: Target, across_m: Any, wider_m: Any = 0.0) -> Any:
    """Return half the opening's length at places across it, all edges wider_m farther out; -inf beyond its sides."""
    along, across = target.half_sizes_m
    y = np.abs(across_m)
    if target.shape == "circle":
        square = (along + wider_m)**2 - y**2
        return np.where(square >= 0.0, np.sqrt(np.maximum(square, 0.0)), -np.inf)
    if target.shape == "rectangle":
        return np.where(y <= across + wider_m, along + wider_m, -np.inf)
    assert isinstance(target.sides, int)
    turns = 2.0 * np.pi * np.arange(target.sides) / target.sides       # of the edges away from the launcher
    turns = turns[np.cos(turns) > 1e-9]
    inside_m = along + wider_m        # from the centre to each edge
    edges = np.stack(np.broadcast_arrays(*((inside_m - y * np.sin(turn)) / np.cos(turn) for turn in turns)))
    width_m = inside_m / np.cos(np.pi / target.sides) if target.sides % 4 else inside_m
    return np.where(y <= width_m, edges.min(axis=0), -np.inf)


def clearance(target: Target, radius_m: Any, angle_rad: Any) -> Any:
    """Return how far inside the near edge, along the plane, a ball that comes at this angle must come down."""
    lip_m = 0.0 if isinstance(target.lip_m, UnsetType) else target.lip_m
    steep = np.abs(np.sin(angle_rad))
    return (radius_m + lip_m * np.abs(np.cos(angle_rad))) / np.maximum(steep, 1e-6)


def outcome_of(target: Target, radius_m: Any, landing: Landing, opening: Opening) -> tuple[np.ndarray, np.ndarray]:
    """Return (0 miss, 1 hit, 2 through the ring; side of each miss: "short", "long", "left", "right", "")."""
    along, across = np.asarray(landing.along_m), np.asarray(landing.across_m)
    reached, wider_m = ~np.isnan(along), np.asarray(opening.two_half_m - target.two_half_height_m)
    half = half_along(target, np.where(reached, across, 0.0), wider_m)
    clear, back = clearance(target, radius_m, landing.angle_rad), np.asarray(landing.angle_rad) > np.pi / 2.0
    with np.errstate(invalid="ignore"):
        low, high = -half + np.where(back, 0.0, clear), half - np.where(back, clear, 0.0)
        beside = reached & ~np.isfinite(half)
        # it came up through the opening, or through the wall below its near edge
        short = ~reached | (along < low) | (np.asarray(landing.rise_m) > -half - np.where(back, 0.0, clear))
        hit = ~beside & ~short & (along <= high)
        inner = hit & (along**2 + across**2 <= np.asarray(opening.three_half_m)**2) & (opening.three_half_m > 0.0)
    side = np.select([hit, beside & (across > 0.0), beside, short], ["", "left", "right", "short"], "long")
    return hit.astype(int) + inner, side
