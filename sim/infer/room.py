"""Room for the smooth errors of a model: curves of launch and flight, whose sizes are estimated from the shots.

Every model of a launcher is slightly wrong, and smoothly so: for example, balls leave steeper at slow wheels, or drag
is not quite quadratic. In a fit without room for such errors, the coefficients absorb them, and later changes are
measured with wrong slopes (Kennedy and O'Hagan 2001). Each curve of ROOM therefore has a constant and smooth shapes
over distance, hood and speed (truearc.sim.infer.belief.smooth), normally distributed about 0. They are in units in
which the constant moves heights by UNIT_M. Their standard deviation is estimated by EM (Dempster et al. 1977) from a
prior of PRIOR_M that counts as much as WEIGHT points, and it is never 0. The points are parameters of the fit like any
other, so a belief holds them with their covariance. The spread between balls is estimated in the same way, from the
prior of the layout, which counts as one ball.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from truearc.sim.infer.belief import SHAPES, Belief, Curve
from truearc.sim.infer.fit import climb
from truearc.sim.infer.launcher import Launcher, LauncherFit
from truearc.sim.infer.likelihood.score_table import Array
from truearc.sim.physics.catalogue import CURVE, find_nameless
from truearc.sim.physics.term import complete
from truearc.sim.statistics import invert

ROOM = {term: complete(find_nameless(term), values) for term, values in {
    "free_speed": {"share": 1.0}, "free_elevation": {"angle_rad": 1.0}, "free_distance": {"bias_m": 1.0},
    "free_push": {"size_m_s2": 1.0, "up": 1.0}}.items()}
OVER = ("distance_m", "hood_deg", "exit_deg", "exit_speed_m_s")
# Chosen: errors of 2 cm where the ball arrives are usual; four points more make little of it
PRIOR_M, WEIGHT = 0.02, 4.0
# Measured on development seasons 20060 to 20064: with 4, a spread of 1.5 % remains of the prior's 3 % where balls are
# alike, and a camera scale of 4 % is found in 4 of 5; with 1 in 5 of 5
BALLS_WEIGHT = 1.0                    # balls, as many as the prior of the spread between balls counts
UNIT_M = 0.1                          # only a unit
# Chosen: ten times; at 45 degrees no height depends on the elevation
MOST_USUAL = 10.0                     # times what a curve's term usually amounts to: the largest unit
EDGES = (2.0, 98.0)                   # percentiles of a covariate between which a curve bends
ROUNDS, STEPS = 2, 30                 # of the fit between estimates of the sizes; of EM on one fit's slopes


@dataclass(frozen=True)
class Room:
    """A fit with room at its optimum; curve: its shapes, the same for all of ROOM; balls: as of `Belief.balls`."""

    fitted: LauncherFit
    curve: Curve
    balls: dict[str, float]


def has_room(belief: Belief) -> bool:
    """Return whether the belief leaves room for what its model gets wrong."""
    return any(curve.over for curve in belief.curves.values())


def open_room(bare: LauncherFit, columns: Mapping[str, Any]) -> Room | None:
    """Return the fit with room; None if all shots have the same settings.

    Args:
        bare: A fit of shared columns alone, with heights or outcomes at the plane and without curves.
        columns: Numbers of each shot of the dataset, by name.
    """
    rows = bare.scores.rows
    known = {name: np.asarray(columns[name])[rows] for name in OVER if name in columns}
    ends = {name: np.percentile(x, EDGES) for name, x in known.items() if np.isfinite(x).all()}
    over = {name: (float(low), float(high)) for name, (low, high) in ends.items() if low < high}
    if not over:
        return None
    curve = Curve((0.0,) * (1 + SHAPES * len(over)), 0.0, over=over)
    model, point = bare.model, bare.point
    for term, values in ROOM.items():
        model = model.along(term, values, curve, curve.by(known, len(rows)))
        point = model.extended(point)
    layout, groups = model.layout, model.layout.groups
    owner = np.array([list(ROOM).index(column.name.split(".")[1]) if column.name.startswith(CURVE + ".") else -1
                      for column in layout.columns[layout.first_shared:]])
    plane = model.linearise(point)[0].plane
    assert plane is not None
    first = layout.first_shared + np.array([int(np.argmax(owner == k)) for k in range(len(ROOM))])
    slope = np.median(np.abs(plane.by_column[:, first]), axis=0)
    unit = np.minimum(UNIT_M / np.maximum(slope, 1e-9), [MOST_USUAL * find_nameless(term).usual for term in ROOM])
    if groups is not None and groups.names:
        owner[-layout.grouped:] = len(ROOM) + np.repeat(np.arange(len(groups.names)), groups.count)
        unit = np.append(unit, np.full(len(groups.names), UNIT_M / PRIOR_M))
    sd = np.full(len(unit), PRIOR_M / UNIT_M)
    for _ in range(ROUNDS):
        found = climb(sized(model, owner, sd * unit), point)
        scores, point = found.scores, found.point
        toward = scores.score.sum(0) + scores.information @ scores.point
        sd = sizes_by_em(scores.information, toward, scores.precision, model.layout.centre, owner, unit)
    spread = {} if groups is None else dict(zip(groups.names, (sd * unit)[len(ROOM):] * groups.scale, strict=False))
    return Room(climb(sized(model, owner, sd * unit), point), curve, {name: float(x) for name, x in spread.items()})


def sized(model: Launcher, owner: Int[Array, " P"], sd: Float[Array, " curves"]) -> Launcher:
    """Return the model with curves of these standard deviations; owner: the number of each column's curve, or -1."""
    return replace(model, layout=replace(model.layout, precision=with_sizes(model.layout.precision, owner, sd)))


def with_sizes(precision: Float[Array, "P P"], owner: Int[Array, " P"],
               sd: Float[Array, " curves"]) -> Float[Array, "P P"]:
    """Return the prior's precision with independent points of these standard deviations."""
    free = owner >= 0
    return np.asarray(np.where(free[:, None] | free, np.diag(np.where(free, sd[owner]**-2.0, 0.0)), precision))


def sizes_by_em(information: Float[Array, "P P"], toward: Float[Array, " P"], precision: Float[Array, "P P"],
                centre: Float[Array, " P"], owner: Int[Array, " P"],
                unit: Float[Array, " curves"]) -> Float[Array, " curves"]:
    """Return each curve's standard deviation, in its units, where the log-likelihood is
    toward @ x - x @ information @ x / 2.

    precision, centre: the prior of columns that are no curve's.
    """
    count = np.array([(owner == k).sum() for k in range(len(unit))])
    weight = np.where(np.arange(len(unit)) < len(ROOM), WEIGHT, BALLS_WEIGHT)
    sd = np.full(len(unit), PRIOR_M / UNIT_M)
    for _ in range(STEPS):
        prior = with_sizes(precision, owner, sd * unit)
        covariance = invert(information + prior)
        square = (covariance @ (toward + prior @ centre))**2 + np.diag(covariance)
        total = np.array([square[owner == k].sum() for k in range(len(unit))]) / unit**2
        sd = np.sqrt((weight * (PRIOR_M / UNIT_M)**2 + total) / (weight + count))
    return sd
