"""JAX forecasts of the height at the plane, made from a belief before the shot, with all sources of uncertainty."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.dataset import Shots
from truearc.sim.infer.belief import SCATTER, Belief, before_the_shot, owners, scale_of
from truearc.sim.infer.likelihood.data import Given, given_of
from truearc.sim.physics.catalogue import CURVE, Catalogue, effective, flight_terms
from truearc.sim.physics.flight import make_law, reach_plane
from truearc.sim.physics.simulate import leave, sense
from truearc.sim.physics.term import Exit, from_scale

STEPS = (1e-3, 1e-3, 1e-2)            # of a launch's deviations, for the heights' derivatives by them

Values = Mapping[str, Mapping[str, Any]]
Number = tuple[str, str, str]         # term, parameter, scale


class Height(NamedTuple):
    """Height at the plane, through the floor if necessary.

    `near` False: the ball turns back, and the rest is meaningless. by_launch: derivatives of the height by a shot's own
    log speed, elevation (rad) and spin (rev/s); by_distance: by the plane's distance.
    """

    height_m: Float[Any, " n"]
    by_launch: Float[Any, "n 3"]
    by_distance: Float[Any, " n"]
    near: Bool[Any, " n"]


def height_at(rig: Rig, values: Values, given: Given, among: Catalogue, log_speed: Float[Any, " n"] | float = 0.0,
              elevation_rad: Float[Any, " n"] | float = 0.0) -> Height:
    """Return heights of launches with these deviations, with their derivatives.

    values: {term: {parameter: value}}; gravity is always at work. A deviation acts on the ball as it leaves, after the
    launch terms. The derivatives by it are central differences of flights side by side, within 1e-5 of their size:
    nesting them into the derivatives by parameters costs a hundred times as much.
    """
    at, exit, distance_m = configured(rig, values, given, among)
    law = make_law(rig, flight_terms({"gravity", *values}, among), at)
    steps = jnp.concatenate([jnp.zeros((1, 3)), jnp.diag(jnp.array(STEPS)), -jnp.diag(jnp.array(STEPS))]).T[:, :, None]
    leaving = Exit(exit.speed_m_s * jnp.exp(log_speed + steps[0]), exit.elevation_rad + elevation_rad + steps[1],
                   exit.spin_rev_s + steps[2], exit.above_m)
    plane = reach_plane(rig, law, leaving, jnp.broadcast_to(distance_m, (7, *jnp.shape(given.distance_m))))
    by_launch = (plane.height_m[1:4] - plane.height_m[4:]) / (2.0 * jnp.array(STEPS)[:, None])
    return Height(plane.height_m[0], by_launch.T, plane.climb[0], plane.near.all(0))


def configured(rig: Rig, values: Values, given: Given,
               among: Catalogue) -> tuple[dict[str, dict[str, Any]], Exit, Float[Any, " n"]]:
    """Return (effective values, launch, distance in m) of the true shots, by sensing and launch terms."""
    at = effective(values, given.circumstances, among)
    exit, distance_m = sense(rig, at, Exit(*map(jnp.asarray, given.rolling)), given.distance_m, given.whose, among)
    return at, leave(rig, at, exit, given.whose, among), distance_m


def speed_gain(rig: Rig, values: Values, given: Given, among: Catalogue) -> Float[Any, " n"]:
    """Return d log(exit speed) / d log(wheel-based speed) [n]: 1 if no launch term depends on the speed."""
    def log_speed(change: Float[Any, ""] | float) -> Float[Any, " n"]:
        faster = given.rolling._replace(speed_m_s=given.rolling.speed_m_s * jnp.exp(change))
        return jnp.log(configured(rig, values, given._replace(rolling=faster), among)[1].speed_m_s)

    return jax.jacfwd(log_speed)(0.0)


class Slopes(NamedTuple):
    """Heights with derivatives by a launch's deviations and by numbers on the parameters' scales [n, p]."""

    height: Height
    by_number: Float[Any, "n p"]
    gain: Float[Any, " n"]


@partial(jax.jit, static_argnames=("rig", "numbers", "among"))
def slopes_at(rig: Rig, fixed: Values, numbers: tuple[Number, ...], at: Float[Any, " p"], given: Given,
              among: Catalogue) -> Slopes:
    """Return heights and exact derivatives; `numbers` names the entries of `at` [p], `fixed` has the values of the
    rest.

    What is added to a curve of the given circumstances is called by the curve's term.
    """
    def height(at: Float[Any, " p"]) -> tuple[Float[Any, " n"], Height]:
        flown = height_at(rig, with_numbers(fixed, numbers, at), along_curve(given, numbers, at), among)
        return flown.height_m, flown

    by_number, flown = jax.jacfwd(height, has_aux=True)(at)
    return Slopes(flown, by_number, speed_gain(rig, with_numbers(fixed, numbers, at), given, among))


def with_numbers(fixed: Values, numbers: tuple[Number, ...], at: Float[Any, " p"]) -> dict[str, dict[str, Any]]:
    """Return `fixed` with the numbers' values in it."""
    values = {name: dict(part) for name, part in fixed.items()}
    for index, (term, parameter, scale) in enumerate(numbers):
        if term != CURVE:
            values.setdefault(term, {})[parameter] = from_scale(scale, at[index])
    return values


def along_curve(given: Given, numbers: tuple[Number, ...], at: Float[Any, " p"]) -> Given:
    """Return the same with what those numbers that are of curves add to the curves' sizes."""
    around = given.circumstances
    for index, (table, term, _) in enumerate(numbers):
        if table == CURVE:
            around = around._replace(**{term: getattr(around, term) + at[index]})
    return given._replace(circumstances=around)


def sensor_variance(height: Height, gain: Float[Any, " n"], given: Given) -> Float[Any, " n"]:
    """Return the variance of the height [n] in m2 from the instruments' noise: wheels, elevation, distance."""
    by_speed, by_elevation, by_spin = (height.by_launch[:, column] for column in range(3))
    wheels = (by_speed * gain)[:, None] * given.wheel_log_speed + by_spin[:, None] * given.wheel_spin_rev_s
    return ((wheels**2).sum(1) + (by_elevation * given.elevation_sd_rad)**2
            + (height.by_distance * given.distance_sd_m)**2)


LANES = 256                           # rows fly in multiples of this, since each size is compiled


@dataclass(frozen=True, eq=False)
class Forecast:
    """Heights at the plane in m and the standard deviations that make sigma_m.

    nan: the ball turns back before the plane, or falls almost straight down far below the floor.

    `launch_m`: scatter from shot to shot; `sensor_m`: noise of what was measured before the shot, rig.toml [noise];
    `parameter_m`: uncertainty of the belief itself, which all shots share. by_launch: derivatives of the height by
    log exit speed, elevation in rad, spin in rev/s and distance in m.
    """

    height_m: Float[np.ndarray, " n"]
    sigma_m: Float[np.ndarray, " n"]
    launch_m: Float[np.ndarray, " n"]
    sensor_m: Float[np.ndarray, " n"]
    parameter_m: Float[np.ndarray, " n"]
    by_launch: Float[np.ndarray, "n 4"]


def forecast(rig: Rig, belief: Belief, shots: Shots) -> Forecast:
    """Forecast each shot from its wheel speeds (or motor_ratio), hood_deg and distance_m; InputError names what lacks.

    First-order propagation with exact derivatives, continuous in all parameters: the flight goes on through the floor.
    """
    given = given_of(rig, shots, before_the_shot(belief.curves, rig, shots))
    rows = [np.arange(first, min(first + LANES, len(given.rolled))) for first in range(0, len(given.rolled), LANES)]
    if not rows:
        none = np.zeros(0)
        return Forecast(none, none, none, none, none, np.zeros((0, 4)))
    parts = [_block(rig, belief, _take(given, np.resize(block, LANES))) for block in rows]
    kept = [[column[:block.size] for column in part] for part, block in zip(parts, rows, strict=True)]
    return Forecast(*(np.concatenate(columns) for columns in zip(*kept, strict=True)))


def _block(rig: Rig, belief: Belief, given: Given) -> tuple[Float[np.ndarray, "lanes ..."], ...]:
    inner = [index for index, name in enumerate(belief.names) if not name.startswith(SCATTER + ".")]
    named = [_number(belief, belief.names[index]) for index in inner]
    at = {one: 0.0 if point else value for (one, point), value in zip(named, belief.values()[inner], strict=True)}
    flown = slopes_at(rig, belief.coefficients, tuple(at), np.array([*at.values()]), given, belief.catalogue)
    height, by_number = (jax.tree.map(np.asarray, part) for part in (flown.height, flown.by_number))
    by_number = by_number[:, [[*at].index(one) for one, _ in named]]
    for column, ((_, term, _), point) in enumerate(named):
        if point:
            place = owners(belief.curves).index(term) + int(point)
            by_number[:, column] *= given.circumstances.curve_by[:, place]
    speed, elevation_deg = (belief.scatter.get(name, 0.0) for name in ("speed", "elevation_deg"))
    launch = (given.rolled * (height.by_launch[:, 0] * speed)**2
              + given.hooded * (height.by_launch[:, 1] * np.radians(elevation_deg))**2)
    sensor = np.asarray(sensor_variance(height, np.asarray(flown.gain), given))
    doubt = np.maximum(np.einsum("ni,ij,nj->n", by_number, belief.covariance[np.ix_(inner, inner)], by_number), 0.0)
    columns = (height.height_m, *map(np.sqrt, (launch + sensor + doubt, launch, sensor, doubt)))
    slopes = np.column_stack([height.by_launch, height.by_distance])
    near = height.near
    return *(np.where(near, column, np.nan) for column in columns), np.where(near[:, None], slopes, np.nan)


def _number(belief: Belief, name: str) -> tuple[Number, str]:
    """The number that is flown for it, and which point of a curve it is, or "": all go with the curve's size."""
    table, _, key = name.partition(".")
    key, _, point = key.partition(".")
    return (table, key, scale_of(name, belief.catalogue)), point


def _take(given: Given, rows: Int[np.ndarray, " lanes"]) -> Given:
    taken: Given = jax.tree.map(lambda part: part if np.ndim(part) == 0 else np.asarray(part)[rows], given)
    return taken
