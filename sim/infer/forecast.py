"""A belief and a configuration -> the height at the plane before the shot, with all that makes it uncertain."""

from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Float, Int

from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.dataset import Shots
from truearc.sim.infer.belief import SCATTER, Belief, scale_of
from truearc.sim.infer.curve import before_the_shot, owners
from truearc.sim.infer.likelihood.heights import Number, sensor_variance, slopes_at
from truearc.sim.infer.likelihood.launch_inputs import Given, given_of
from truearc.sim.physics.nonparametric import CURVE

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
    numbers = tuple(_number(belief, belief.names[index]) for index in inner)
    flown = slopes_at(rig, belief.coefficients, numbers, belief.values()[inner], given, belief.catalogue)
    height, by_number = (jax.tree.map(np.asarray, part) for part in (flown.height, flown.by_number))
    speed, elevation_deg = (belief.scatter.get(name, 0.0) for name in ("speed", "elevation_deg"))
    launch = (given.rolled * (height.by_launch[:, 0] * speed)**2
              + given.hooded * (height.by_launch[:, 1] * np.radians(elevation_deg))**2)
    sensor = np.asarray(sensor_variance(height, np.asarray(flown.gain), given))
    known = belief.covariance[np.ix_(inner, inner)]
    doubt = np.maximum(np.einsum("ni,ij,nj->n", by_number, known, by_number), 0.0)
    columns = (height.height_m, *map(np.sqrt, (launch + sensor + doubt, launch, sensor, doubt)))
    slopes = np.column_stack([height.by_launch, height.by_distance])
    near = height.near
    return *(np.where(near, column, np.nan) for column in columns), np.where(near[:, None], slopes, np.nan)


def _number(belief: Belief, name: str) -> Number:
    table, _, key = name.partition(".")
    if table == CURVE:
        term, _, point = key.partition(".")
        key = f"{term}.{owners(belief.curves).index(term) + int(point)}"
    return table, key, scale_of(name, belief.catalogue)


def _take(given: Given, rows: Int[np.ndarray, " lanes"]) -> Given:
    taken: Given = jax.tree.map(lambda part: part if np.ndim(part) == 0 else np.asarray(part)[rows], given)
    return taken
