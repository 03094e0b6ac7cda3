"""The forward model of a shot (JAX), from sensor readings to the height at the plane and the track.

It is differentiable in the parameters of all terms, in the deviations of each launch, and in free pushes (arbitrary
smooth forces). Its stages: sensed configuration -> sensing terms -> launch terms -> launch deviation -> flight ->
arrival, watch terms.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import msgspec
import numpy as np
from jax import lax
from jaxtyping import Bool, Float, Int

from truearc.robot.config.rig_spec import Ball, Rig
from truearc.sim.compute import each_core
from truearc.sim.data.dataset import Circumstances
from truearc.sim.infer.belief import resized
from truearc.sim.physics import catalogue as stages
from truearc.sim.physics.catalogue import BUILT_IN, CURVE, Catalogue, effective, find_terms
from truearc.sim.physics.facing_up import Plane
from truearc.sim.physics.flight import AHEAD, SHARE, SLOWEST_M_S, Law, apart, make_law, together
from truearc.sim.physics.term import DIRECTIONS, BallState, Exit, InFlight, Opening, Vec, add, axes

# How one shot differs from its configuration. The last three are of flights whose launch is unknown.
DEVIATES = ("log_speed", "elevation_rad", "azimuth_rad", "spin_share", "distance_m", "lead_s",
            "drag_share", "spin_ratio", "x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s")
PLANE_DEVIATES, LAUNCHED_DEVIATES = 5, 11  # how many of them there are at the plane, and where the launch is known
PLANE_STEPS = 16                      # Runge-Kutta over x: heights within 1e-4 m, far below any spread
PAD = 32                              # lanes fly in multiples of this, since each size is compiled,
BLOCK = 64                            # and at most this number at once: more do not fit the caches
POINTS = 64                           # likewise, of parameters at which heights are asked for
WIDTH = 12                            # slopes that are flown together; bounds memory and compilations
LEAD_STEPS = 3                        # from the launch to the first sample of its track; Runge-Kutta
TINY_M_S = 1e-9                       # of a ball that falls straight down; bounds 1 / speed
LOWEST_M = -6.0                       # below the floor: no height there could be a hit
ROUGH_STEPS, FALL_STEPS = 40, 16      # down to an opening that faces up: to see when, and to see where
LEAST_M_S, LEAST_M_S2 = 0.05, 0.1     # bounds of divisors where a ball hardly falls
REACH = 5.0                           # of a ball that never rises to the rim; chosen: as steep as near a flight's top

Slot = tuple[str, str]                # term, parameter
Array = jax.Array | np.ndarray
Number = Float[Array, ""]
State = Float[jax.Array, "7"]         # x, y, z, vx, vy, vz, t
Rate = Callable[[State], State]


class ShotBatch(NamedTuple):
    """Shots as arrays [n, ...], or one without the n; launcher frame.

    rolling: launch by the sensors, before any term; side_spin_rev_s [n, 2]: what else it spins, about the direction of
    flight and about up across it. `rolled`, `hooded`: speed and spin are the wheels', the elevation the hood's, so that
    terms about these act; not where a camera measured the ball. ball_kg, ball_m: mass and radius of its ball. `free`:
    the launch is unknown; then start_m, start_m_s and spin_rev_s say how the track begins. lead_s: from launch to the
    first sample; time_s from the first sample, padded with its last.
    """

    rolling: Exit
    side_spin_rev_s: Float[Array, "*n 2"]
    rolled: Bool[Array, "*n"]
    hooded: Bool[Array, "*n"]
    free: Bool[Array, "*n"]
    ball_kg: Float[Array, "*n"]
    ball_m: Float[Array, "*n"]
    distance_m: Float[Array, "*n"]
    circumstances: Circumstances
    start_m: Float[Array, "*n 3"]
    start_m_s: Float[Array, "*n 3"]
    spin_rev_s: Float[Array, "*n 3"]
    lead_s: Float[Array, "*n"]
    time_s: Float[Array, "*n L"]

    def take(self, rows: Int[np.ndarray, " k"] | slice) -> "ShotBatch":
        """Return the rows' shots; numbers shared by all shots stay unchanged."""
        taken: ShotBatch = jax.tree.map(lambda part: np.asarray(part)[rows] if np.ndim(part) else part, self)
        return taken


class Prediction(NamedTuple):
    """The chain's results, of one lane or of lanes [n]; or their derivatives, with one more axis at the end.

    exit: log speed, elevation in rad, backspin in rev/s, of the ball as it leaves. plane: of an upright target, height
    above its centre, lateral position, half heights of three and two points, all in m. Of one that faces up, places
    along and across in the plane of the rim, the ring's radius, half the length (m), velocity along and down (m/s),
    height of the highest point above the rim (m), bounce of the backboard, speed of the ball's front by backspin (m/s),
    place along at the highest point (m), acceleration toward the rim (m/s2).
    near: the ball came there. track_m: positions by the tracker.
    """

    exit: Float[Array, "*n 3"]
    plane: Float[Array, "*n axes"]
    near: Bool[Array, "*n"]
    track_m: Float[Array, "*n L 3"]


@dataclass(frozen=True)
class Chain:
    """The static arguments that the functions below are compiled for.

    `slots`: parameters that may be varied; those of terms that are not among `terms` do nothing. bands: number of
    stretches of the flight in which a free push may act, besides all of it. free: some launches are unknown. catalogue:
    of the terms. rig: noise and beliefs play no part here; strip them, so that the compiled code is shared, as it is by
    rigs that differ in their numbers.
    """

    rig: Rig
    terms: tuple[str, ...]
    slots: tuple[Slot, ...]
    bands: int = 0
    substeps: int = 1
    plane: bool = True
    track: bool = True
    free: bool = True
    catalogue: Catalogue = BUILT_IN

    @property
    def deviates(self) -> int:
        """Return how many of DEVIATES are used, from the first; without tracks nothing depends on the others."""
        if not self.track:
            return PLANE_DEVIATES
        return len(DEVIATES) if self.free else LAUNCHED_DEVIATES

    @property
    def pushes(self) -> int:
        """Return the free accelerations: per direction throughout, in each band, and in proportion to the speed."""
        return len(DIRECTIONS) * (self.bands + 2) if self.bands else len(DIRECTIONS)

    @property
    def size(self) -> int:
        return len(self.slots) + self.deviates + self.pushes


def see_slopes(chain: Chain, lanes: ShotBatch, point: Float[Array, " slots"], deviates: Float[Array, "n D"],
               edges_s: Float[Array, " edges"], basis: Float[Array, "size k"]) -> tuple[Prediction, Prediction]:
    """Return (prediction at the parameters `point` and the deviates, its derivatives along the columns of `basis`).

    The rows of `basis` are the chain's inputs: slots, deviates, pushes. edges_s: between bands of the flight's time.
    """
    shape, numbers = apart(chain.rig)
    seen: tuple[Prediction, Prediction] = _see_slopes(replace(chain, rig=shape), numbers, lanes, point, deviates,
                                                      edges_s, basis)
    return seen


@partial(jax.jit, static_argnames=("chain",))
def _see_slopes(chain: Chain, numbers: Float[Array, " rig"], lanes: ShotBatch, point: Float[Array, " slots"],
                deviates: Float[Array, "n D"], edges_s: Float[Array, " edges"],
                basis: Float[Array, "size k"]) -> tuple[Prediction, Prediction]:
    chain = replace(chain, rig=together(chain.rig, numbers))
    pushes = jnp.zeros(chain.pushes)

    def one(lane: ShotBatch, deviate: Float[Array, " D"]) -> tuple[Prediction, Prediction]:
        here = jnp.concatenate([point, deviate, pushes])

        def moved(step: Float[jax.Array, " k"]) -> tuple[Prediction, Prediction]:
            seen = _see(chain, lane, here + basis @ step, edges_s)
            return seen._replace(near=jnp.zeros(())), seen

        slopes, seen = jax.jacfwd(moved, has_aux=True)(jnp.zeros(basis.shape[1]))
        return seen, slopes

    return jax.vmap(one)(lanes, deviates)


def pad_lanes(lanes: ShotBatch) -> tuple[ShotBatch, int]:
    """Return (lanes repeated up to a multiple of PAD, or of BLOCK if there are more; their original number)."""
    n = len(lanes.distance_m)
    multiple = PAD if n <= BLOCK else BLOCK
    return lanes.take(np.resize(np.arange(n), -(-n // multiple) * multiple)), n


def see_in_blocks(chain: Chain, lanes: ShotBatch, point: Float[np.ndarray, " slots"],
                  deviates: Float[np.ndarray, "n D"], edges_s: Float[np.ndarray, " edges"],
                  basis: Float[np.ndarray, "size k"],
                  see: Callable[..., Any] | None = None) -> tuple[Prediction, Prediction]:
    """Run see_slopes on all lanes and all cores, returning numpy arrays.

    BLOCK lanes and WIDTH slopes are computed at a time, so that one compilation serves all. see: in place of
    see_slopes.
    """
    padded, n = pad_lanes(lanes)
    every = np.resize(deviates, (len(padded.distance_m), deviates.shape[1]))
    width = basis.shape[1]
    wide = np.pad(basis, ((0, 0), (0, -width % WIDTH if width else WIDTH)))
    bases = np.split(wide, wide.shape[1] // WIDTH, axis=1)
    blocks = [slice(first, first + BLOCK) for first in range(0, len(every), BLOCK)]

    def fly(job: tuple[slice, Float[np.ndarray, "size k"]]) -> tuple[Prediction, Prediction]:
        found: tuple[Prediction, Prediction] = jax.tree.map(np.asarray, (see or see_slopes)(
            chain, padded.take(job[0]), jnp.asarray(point), every[job[0]], jnp.asarray(edges_s), jnp.asarray(job[1])))
        return found

    code = chain, len(every[:BLOCK]), np.shape(lanes.time_s)[1:], see
    flown = each_core(fly, list(product(blocks, bases)), code)
    parts = [flown[first:first + len(bases)] for first in range(0, len(flown), len(bases))]
    seen = jax.tree.map(lambda *each: np.concatenate(each)[:n], *(part[0][0] for part in parts))
    slopes = [jax.tree.map(lambda *each: np.concatenate(each, axis=-1), *(one for _, one in part)) for part in parts]
    return seen, jax.tree.map(lambda *each: np.concatenate(each)[:n][..., :width], *slopes)


def plane_grid(chain: Chain, lanes: ShotBatch,
               points: Float[Array, "g slots"]) -> tuple[Float[Array, "g n"], Bool[Array, "g n"]]:
    """Return heights above the target's centre and whether the ball reached the plane, for each of the parameters
    `points`."""
    shape, numbers = apart(chain.rig)
    # nothing of tracks, and points in multiples: each other form would be compiled
    bare = replace(chain, rig=shape, track=False, bands=0, substeps=1, free=False)
    some = points[np.resize(np.arange(len(points)), -(-len(points) // POINTS) * POINTS)]
    height_m, near = _plane_grid(bare, numbers, lanes._replace(time_s=lanes.time_s[:, :1]), some)
    return height_m[:len(points)], near[:len(points)]


@partial(jax.jit, static_argnames=("chain",))
def _plane_grid(chain: Chain, numbers: Float[Array, " rig"], lanes: ShotBatch,
                points: Float[Array, "g slots"]) -> tuple[Float[Array, "g n"], Bool[Array, "g n"]]:
    chain = replace(chain, rig=together(chain.rig, numbers))
    rest = jnp.zeros(chain.size - len(chain.slots))

    def one(point: Float[Array, " slots"], lane: ShotBatch) -> tuple[Number, Bool[Array, ""]]:
        seen = _see(chain, lane, jnp.concatenate([point, rest]), jnp.zeros(max(chain.bands - 1, 0)))
        return seen.plane[0], seen.near

    return jax.vmap(lambda point: jax.vmap(lambda lane: one(point, lane))(lanes))(points)


def _see(chain: Chain, lane: ShotBatch, at: Float[jax.Array, " size"], edges_s: Float[Array, " edges"]) -> Prediction:
    slots, count = len(chain.slots), chain.deviates
    values = _values(chain, at[:slots], lane.circumstances)
    ball_kg, ball_m = cast(tuple[Any, Any], (lane.ball_kg, lane.ball_m))
    rig = msgspec.structs.replace(chain.rig, ball=Ball(ball_kg, ball_m))
    deviate = jnp.concatenate([at[slots:slots + count], jnp.zeros(len(DEVIATES) - count)])
    pushes = at[slots + count:]
    flying = stages.flight_terms(chain.terms, chain.catalogue)
    own = _own(flying, values, deviate[6])
    law = make_law(rig, flying, own)
    push = partial(_push, pushes.reshape(len(DIRECTIONS), -1), edges_s)
    exit, distance_m = _leave(chain, rig, values, lane, deviate)
    ball = _start(rig, lane, exit, deviate)
    measured = jnp.stack([jnp.log(exit.speed_m_s), exit.elevation_rad, exit.spin_rev_s])
    if not chain.plane:
        plane, near = jnp.zeros(4), jnp.array(False)
    elif rig.target is not None and rig.target.faces_up:
        still = lax.stop_gradient((own, pushes, ball.spin_rev_s))
        rough = partial(_rate, make_law(rig, flying, still[0]),
                        partial(_push, still[1].reshape(len(DIRECTIONS), -1), edges_s), still[2])
        opening = _opening(chain, values)
        plane, near = _descend(rig, opening, partial(_rate, law, push, ball.spin_rev_s), rough, ball, distance_m)
    else:
        plane, near = _plane(chain, values, law, push, ball, distance_m)
    track_m = _track(chain, values, law, push, ball, lane, deviate) if chain.track else jnp.zeros((0, 3))
    return Prediction(measured, plane, near, track_m)


def _values(chain: Chain, at: Float[jax.Array, " slots"], circumstances: Circumstances) -> dict[str, dict[str, Any]]:
    """Effective values of all terms at the slots' numbers."""
    raw: dict[str, dict[str, Any]] = {
        term.name: {p.name: p.default for p in term.parameters} for term in find_terms(chain.terms, chain.catalogue)}
    for index, (name, parameter) in enumerate(chain.slots):
        if name in raw:
            raw[name][parameter] = at[index]
    points = {index: key.partition(".")[0] for index, (name, key) in enumerate(chain.slots) if name == CURVE}
    if points:
        circumstances = resized(circumstances, tuple(points.values()), at[jnp.array(tuple(points))])
    return effective(raw, circumstances, chain.catalogue)


def _own(flying: Sequence[InFlight], values: dict[str, dict[str, Any]],
         drag_share: Number) -> dict[str, dict[str, Any]]:
    """With this very flight's own drag: what each ball has its own of differs a little from flight to flight, too."""
    own = {term.name: {one.name: values[term.name][one.name] * (1.0 + drag_share)
                       for one in term.parameters if one.fit_each_ball} for term in flying}
    return {name: {**given, **own.get(name, {})} for name, given in values.items()}


def _leave(chain: Chain, rig: Rig, values: Mapping[str, Any], lane: ShotBatch,
           deviate: Float[jax.Array, "14"]) -> tuple[Exit, Number]:
    """The launch as it is, and the true distance: sensing terms, launch terms, the shot's own deviation.

    Speed and spin that a camera measured are not the wheels': there only the elevation by the hood is corrected.
    """
    sensed = Exit(*map(jnp.asarray, lane.rolling))
    exit, distance_m = sensed, lane.distance_m
    for sensing in stages.sensing_terms(values, chain.catalogue):
        exit, distance_m = sensing.sense(rig, values[sensing.name], exit, distance_m)
    for launching in stages.launch_terms(values, chain.catalogue):
        exit = launching.leave(rig, values[launching.name], exit)
    speed = jnp.where(lane.rolled, exit.speed_m_s, sensed.speed_m_s)
    spin = jnp.where(lane.rolled, exit.spin_rev_s, sensed.spin_rev_s)
    elevation = jnp.where(lane.hooded, exit.elevation_rad, sensed.elevation_rad)
    speed = speed * jnp.exp(deviate[0])
    spin = spin * (1.0 + deviate[3]) + deviate[7] * speed / (2.0 * jnp.pi * rig.ball.radius_m)
    return Exit(speed, elevation + deviate[1], spin, exit.above_m), distance_m + deviate[4]


def _start(rig: Rig, lane: ShotBatch, exit: Exit, deviate: Float[jax.Array, "14"]) -> BallState:
    """The ball as it leaves, or where its track begins."""
    level, rise = jnp.cos(exit.elevation_rad), jnp.sin(exit.elevation_rad)
    aside, ahead = jnp.sin(deviate[2]), jnp.cos(deviate[2])
    along = jnp.stack([level * ahead, level * aside, rise])
    left = jnp.stack([-aside, ahead, jnp.zeros_like(ahead)])
    up = jnp.cross(along, left)
    spin = lane.side_spin_rev_s[0] * along - exit.spin_rev_s * left + lane.side_spin_rev_s[1] * up
    place = jnp.stack([0.0 * level, 0.0 * level, rig.launcher.release_height_m + exit.above_m + 0.0 * level])
    place = jnp.where(lane.free, lane.start_m, place) + deviate[8:11]
    velocity = jnp.where(lane.free, lane.start_m_s, exit.speed_m_s * along) + deviate[11:14]
    level_m_s = jnp.sqrt(velocity[0]**2 + velocity[1]**2 + TINY_M_S**2)
    own = deviate[7] * jnp.stack([velocity[1], -velocity[0], 0.0 * level_m_s]) * (
        jnp.sqrt(1.0 + (velocity[2] / level_m_s)**2) / (2.0 * jnp.pi * rig.ball.radius_m))
    spin = jnp.where(lane.free, lane.spin_rev_s * (1.0 + deviate[3]) + own, spin)
    return BallState(Vec(*place), Vec(*velocity), Vec(*spin), jnp.zeros(()))


def _push(pushes: Float[jax.Array, "3 shapes"], edges_s: Float[Array, " edges"], ball: BallState) -> Vec:
    """Free acceleration at a moment of the flight: `pushes` [direction, throughout | bands | with the speed]."""
    velocity = ball.velocity_m_s
    speed = jnp.sqrt(velocity.x**2 + velocity.y**2 + velocity.z**2 + 1e-12)
    shape = jnp.ones(1)
    if pushes.shape[1] > 1:
        band = jnp.arange(pushes.shape[1] - 2) == jnp.sum(edges_s < ball.time_s)     # searchsorted would be a loop
        shape = jnp.concatenate([shape, band.astype(float), jnp.array([speed / 10.0])])
    size = pushes @ shape
    along, up, left = axes(velocity)
    return Vec(*(size[0] * a + size[1] * u + size[2] * b for a, u, b in zip(along, up, left, strict=True)))


def _plane(chain: Chain, values: Mapping[str, Any], law: Law, push: Law, ball: BallState,
           distance_m: Number) -> tuple[Float[jax.Array, "4"], Bool[jax.Array, ""]]:
    """(as in Prediction.plane, near): over x, through the floor if need be."""
    step_m = (distance_m - ball.position_m.x) / PLANE_STEPS

    def rate(state: State) -> State:
        """By x."""
        pace = jnp.maximum(state[3], SLOWEST_M_S)
        return _rate(law, push, ball.spin_rev_s, jnp.concatenate([state[:3], pace[None], state[4:]])) / pace

    def advance(carry: tuple[State, Bool[jax.Array, ""]], _: None) -> tuple[tuple[State, Bool[jax.Array, ""]], None]:
        state, near = carry
        new = _runge_kutta(rate, state, step_m)
        near = near & (new[3] > SLOWEST_M_S) & (new[2] > LOWEST_M) & jnp.all(jnp.isfinite(new))
        return (jnp.where(near, new, state), near), None

    start = _pack(ball)
    (end, near), _ = lax.scan(advance, (start, (start[3] > SLOWEST_M_S) & (step_m > 0.0)), None, length=PLANE_STEPS)
    opening = _opening(chain, values)
    return jnp.stack([end[2] - opening.centre_m, end[1], opening.three_half_m + 0.0 * end[1],
                      opening.two_half_m + 0.0 * end[1]]), near


def _opening(chain: Chain, values: Mapping[str, Any]) -> Opening:
    """As the arrival terms make it."""
    target = chain.rig.target
    opening = Opening(target.centre_height_m, target.three_half_height_m, target.two_half_height_m) if target else (
        Opening(0.0, 0.07, 0.35))
    for term in stages.arrival_terms(values, chain.catalogue):
        opening = term.arrive(values[term.name], opening)
    return opening


def _descend(rig: Rig, opening: Opening, rate: Rate, rough: Rate, ball: BallState,
             distance_m: Number) -> tuple[Float[jax.Array, "11"], Bool[jax.Array, ""]]:
    """(as in Prediction.plane, near): where the ball last goes down through the plane of an opening that faces up,
    behind its backboard if need be.

    When it does so is found on a rough flight, without derivatives; then it flies there in FALL_STEPS. Of a ball that
    never rises to the plane the place is made up: in front of the opening, by REACH times what it lacks.
    """
    assert rig.target is not None
    plane = Plane.of(rig.target, distance_m, opening.centre_m)
    start = _pack(ball)

    def apart(state: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Height above the plane, and its rate."""
        return (plane.above(state[..., 0] - plane.distance_m, state[..., 2] - plane.height_m),
                plane.above(state[..., 3], state[..., 5]))

    begin, gravity = lax.stop_gradient(start), jnp.maximum(rig.world.gravity_m_s2, LEAST_M_S2)
    # twice a flight without air to a metre below the floor: a ball with backspin stays aloft longer
    longest_s = 2.0 * (begin[5] + jnp.sqrt(begin[5]**2 + 2.0 * gravity * (jnp.abs(begin[2]) + 1.0))) / gravity
    step_s = longest_s / ROUGH_STEPS
    after = lax.scan(lambda state, _: (_runge_kutta(rough, state, step_s),) * 2, begin, None, length=ROUGH_STEPS)[1]
    height, speed = lax.stop_gradient(apart(jnp.concatenate([begin[None], after])))
    # by the parabola through both ends of each step
    bend = jnp.maximum(2.0 * (height[:-1] + speed[:-1] * step_s - height[1:]) / step_s**2, LEAST_M_S2)
    under = speed[:-1]**2 + 2.0 * bend * height[:-1]
    part_s = (speed[:-1] + jnp.sqrt(jnp.maximum(under, 0.0))) / bend
    falls = (under >= 0.0) & (part_s >= 0.0) & (part_s < step_s)
    reached, top = jnp.any(falls), jnp.argmax(height)
    last = jnp.where(reached, ROUGH_STEPS - 1 - jnp.argmax(falls[::-1]), jnp.minimum(top, ROUGH_STEPS - 1))
    time_s = last * step_s + jnp.where(reached, part_s[last], jnp.clip(speed[last] / bend[last], -step_s, step_s))
    end = lax.scan(lambda state, _: (_runge_kutta(rate, state, time_s / FALL_STEPS), None), start, None,
                   length=FALL_STEPS)[0]
    for _ in range(2):
        above_m, rising = apart(end)
        rest_s = jnp.where(reached, -above_m / jnp.minimum(rising, -LEAST_M_S), 0.0)
        end = _runge_kutta(rate, end, jnp.clip(rest_s, -step_s, step_s))
    above_m, rising = apart(end)
    along = plane.along(end[0] - plane.distance_m, end[2] - plane.height_m)
    ahead = plane.along(end[3], end[5])
    down = jnp.where(reached, -rising, ahead)
    place = jnp.where(reached, along, -opening.two_half_m + REACH * above_m)
    # its highest point, by the parabola through the end
    slope = rate(end)
    pull = jnp.maximum(-plane.above(slope[3], slope[5]), LEAST_M_S2)
    top_m, apex_m = above_m + 0.5 * rising**2 / pull, along + ahead * rising / pull
    front_m_s = -2.0 * jnp.pi * rig.ball.radius_m * ball.spin_rev_s.y
    found = jnp.stack([place, end[1], opening.three_half_m + 0.0 * end[1], opening.two_half_m + 0.0 * end[1], ahead,
                       down, top_m, opening.bounce + 0.0 * end[1], front_m_s + 0.0 * end[1], apex_m, pull])
    return found, jnp.all(jnp.isfinite(found))


def _track(chain: Chain, values: Mapping[str, Any], law: Law, push: Law, ball: BallState, lane: ShotBatch,
           deviate: Float[jax.Array, "14"]) -> Float[jax.Array, "L 3"]:
    """Positions that the tracker gives at its own times."""
    rate = partial(_rate, law, push, ball.spin_rev_s)

    def advance(state: State, step_s: Number) -> tuple[State, Float[jax.Array, "6"]]:
        state = _runge_kutta(rate, state, step_s)
        return state, state[:6]

    lead_s = lane.lead_s + deviate[5]
    # one loop, which is compiled once: the steps to the first sample, and on from there
    lead = jnp.broadcast_to(lead_s / LEAD_STEPS, (LEAD_STEPS,))
    steps_s = jnp.concatenate([lead, jnp.repeat(jnp.diff(lane.time_s) / chain.substeps, chain.substeps)])
    states = lax.scan(advance, _pack(ball), steps_s)[1][LEAD_STEPS - 1::chain.substeps]
    place, velocity = states[:, :3], states[:, 3:]
    seen = Vec(*place.T)
    for term in stages.watch_terms(values, chain.catalogue):
        seen = term.watch(values[term.name], seen, Vec(*velocity.T), lead_s + lane.time_s)
    return jnp.stack(seen, axis=1)


def _pack(ball: BallState) -> State:
    return jnp.stack([*ball.position_m, *ball.velocity_m_s, ball.time_s])


def _rate(law: Law, push: Law, spin_rev_s: Vec, state: State) -> State:
    """By time."""
    here = BallState(Vec(*state[:3]), Vec(*state[3:6]), spin_rev_s, state[6])
    return jnp.concatenate([state[3:6], jnp.stack(add(law(here), push(here))), jnp.ones(1)])


def _runge_kutta(rate: Rate, state: State, step: Number) -> State:
    """One classical step; its four stages are a loop, which compiles in a third of the time."""
    def stage(carry: tuple[State, State], weights: tuple[Number, Number]) -> tuple[tuple[State, State], None]:
        here, total = carry
        slope = rate(here)
        return (state + weights[0] * step * slope, total + weights[1] * slope), None

    weights = (jnp.array(AHEAD), jnp.array(SHARE))
    total = lax.scan(stage, (state, jnp.zeros_like(state)), weights)[0][1]
    return state + step * total
