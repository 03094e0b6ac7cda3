"""What is thought of the fitted numbers before the data: the catalogue's wide priors, or what a session left."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim.belief import SCATTER, Belief, scale_of
from sim.discover.evidence import Array, Column
from sim.physics.catalogue import find_parameter
from sim.physics.scales import LEFT, LOG

# Names of scatters here -> in a belief; the others are of sensors, not of the launch.
SCATTERS = {"scatter.speed": "speed", "scatter.elevation_rad": "elevation_deg"}
SUREST = 1e-4                         # of the catalogue's doubt: a belief may take some combination for exact
MOVES = 0.3                           # of a parameter's prior deviation, by which one and the same rig may have changed


def believed_name(name: str) -> str:
    """What a belief calls the column."""
    return f"{SCATTER}.{SCATTERS[name]}" if name in SCATTERS else name


def own_value(belief: Belief, name: str) -> float:
    """The belief's value of a column that it knows, in the column's unit (scatters: the logarithm)."""
    value = belief.value(believed_name(name))
    if name not in SCATTERS:
        return value
    return float(np.log(np.radians(value) if name.endswith("_rad") else value))


def own_slope(name: str, value: float) -> float:
    """d(column) / d(number on its scale), on which beliefs have their covariance; `value` in the column's unit."""
    if name in SCATTERS:
        return 1.0                    # columns of scatters are logarithms already
    return {LOG: value, LEFT: 1.0 - value}.get(scale_of(name), 1.0)


def inform(columns: Sequence[Column], centre: Array, sd: Array, belief: Belief | None) -> tuple[Array, Array]:
    """(centre [p], precision [p, p]) of columns with independent priors, of which the belief, if any, knows better.

    A coefficient that the belief states without doubt keeps its width and takes the belief's value.
    """
    centre, covariance = centre.copy(), np.diag(sd**2.0)
    if belief is None:
        return centre, np.diag(sd**-2.0)
    for k, column in enumerate(columns):
        if has_value(belief, column.name):
            centre[k] = own_value(belief, column.name)
    known = [k for k, column in enumerate(columns) if believed_name(column.name) in belief.names]
    number = [belief.names.index(believed_name(columns[k].name)) for k in known]
    slope = np.array([own_slope(columns[k].name, centre[k]) for k in known])
    covariance[np.ix_(known, known)] = belief.covariance[np.ix_(number, number)] * np.outer(slope, slope)
    covariance += np.diag((SUREST * sd)**2)
    return centre, np.linalg.inv(covariance)


def tell(columns: Sequence[Column], belief: Belief | None) -> list[Column]:
    """The columns, marked where the belief knows them."""
    names = () if belief is None else belief.names
    return [replace(column, told=believed_name(column.name) in names) for column in columns]


def has_value(belief: Belief, name: str) -> bool:
    """Whether the belief says anything of the column."""
    table, _, key = believed_name(name).partition(".")
    return key in (belief.scatter if table == SCATTER else belief.coefficients.get(table, {}))


def may_have_moved(belief: Belief | None, name: str) -> float | None:
    """By how much a parameter that the belief knows usually changes, in its own unit; None where it knows none."""
    if belief is None or name in SCATTERS or name not in belief.names:
        return None
    prior = find_parameter(name).prior
    if prior is None:
        return None
    return MOVES * prior.sd * {LOG: prior.centre, LEFT: 1.0 - prior.centre}.get(prior.scale, 1.0)
