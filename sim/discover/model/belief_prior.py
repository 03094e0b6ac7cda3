"""What is thought of the fitted numbers before the data: the catalogue's wide priors, or what a session left."""

from dataclasses import replace

import numpy as np

from truearc.sim.discover.model.linearization import ParameterLayout
from truearc.sim.infer.belief import SCATTER, Belief, scale_of
from truearc.sim.physics.catalogue import Catalogue, find_parameter
from truearc.sim.physics.scales import LEFT, LOG

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


def own_slope(name: str, value: float, among: Catalogue) -> float:
    """d(column) / d(number on its scale), on which beliefs have their covariance; `value` in the column's unit."""
    if name in SCATTERS:
        return 1.0                    # columns of scatters are logarithms already
    return {LOG: value, LEFT: 1.0 - value}.get(scale_of(name, among), 1.0)


def inform(layout: ParameterLayout, belief: Belief, sure: bool = True) -> ParameterLayout:
    """The layout, whose priors are independent, with what the belief knows better.

    A coefficient that the belief states without doubt keeps its width and takes the belief's value; so do all where it
    is not `sure`.
    """
    first = len(layout.columns) - len(layout.precision)
    columns = [replace(column, told=column.told or believed_name(column.name) in belief.names)
               for column in layout.columns[first:]]
    centre, covariance = layout.centre.copy(), np.diag(1.0 / np.diag(layout.precision))
    usual = np.sqrt(np.diag(covariance))
    for k, column in enumerate(columns):
        if belief.has(believed_name(column.name)):
            centre[k] = own_value(belief, column.name)
    if not sure:
        return replace(layout, centre=centre)
    known = [k for k, column in enumerate(columns) if believed_name(column.name) in belief.names]
    number = [belief.names.index(believed_name(columns[k].name)) for k in known]
    slope = np.array([own_slope(columns[k].name, centre[k], belief.catalogue) for k in known])
    covariance[np.ix_(known, known)] = belief.covariance[np.ix_(number, number)] * np.outer(slope, slope)
    covariance += np.diag((SUREST * usual)**2)
    return replace(layout, columns=(*layout.columns[:first], *columns), centre=centre,
                   precision=np.linalg.inv(covariance))


def may_have_moved(belief: Belief | None, name: str) -> float | None:
    """By how much a parameter that the belief knows usually changes, in its own unit; None where it knows none."""
    if belief is None or name in SCATTERS or name not in belief.names:
        return None
    prior = find_parameter(name, belief.catalogue).prior
    if prior is None:
        return None
    return MOVES * prior.sd * {LOG: prior.centre, LEFT: 1.0 - prior.centre}.get(prior.scale, 1.0)
