"""Priors of the shared parameters: the catalogue's wide ones, or the posterior of an earlier session."""

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import block_diag

from truearc.sim.infer.belief import SCATTER, Belief, scale_of
from truearc.sim.infer.curve import Curve
from truearc.sim.infer.likelihood.linearization import ParameterLayout
from truearc.sim.infer.likelihood.score_table import Array, Column
from truearc.sim.physics.catalogue import Catalogue, find_parameter
from truearc.sim.physics.nonparametric import CURVE, find_nameless
from truearc.sim.physics.term import complete
from truearc.sim.physics.term_fields import LEFT, LOG

# Names of scatters here -> in a belief; the others are of sensors, not of the launch.
SCATTERS = {"scatter.speed": "speed", "scatter.elevation_rad": "elevation_deg"}
SUREST = 1e-4                         # of the catalogue's deviation: a belief may have some combination as exact
MOVES = 0.3                           # of a parameter's prior deviation, by which one and the same rig may have changed


def believed_name(name: str) -> str:
    """Return the column's name in a belief."""
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

    A coefficient that the belief states without uncertainty keeps its width and takes the belief's value; so do all
    where it is not `sure`.
    """
    first = layout.first_shared
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


def widened(precision: Float[Array, "p p"], by: Iterable[tuple[int, float]]) -> Float[Array, "p p"]:
    """The prior's precision once numbers [(place, standard deviation)] may have changed (Sherman and Morrison)."""
    for place, sd in by:
        row = precision[place]
        precision = precision - np.outer(row, row) * sd**2 / (1.0 + sd**2 * row[place])
    return precision


def bent(layout: ParameterLayout, belief: Belief) -> ParameterLayout:
    """The layout with the belief's unexplained effects, and the points of their curves among the shared columns."""
    for name, curve in belief.curves.items():
        layout = with_curve(layout, name, belief.coefficients[name], curve)
    return layout


def with_curve(layout: ParameterLayout, name: str, values: Mapping[str, float], curve: Curve) -> ParameterLayout:
    """The layout with the nameless term `name`, its parameters fixed, and the curve's points in front of the shared
    columns; they start where the curve has them."""
    chain, term = layout.chain, find_nameless(name)
    whole = complete(term, values)
    old, first = len(chain.slots), layout.first_shared
    slots = (*((name, key) for key in whole), *((CURVE, f"{name}.{key}") for key in curve.keys))
    points = old + len(whole) + np.arange(len(curve.fitted))
    columns = [Column(f"{CURVE}.{name}.{key}", "shared", term.stage, "along", term.amplitude.unit, term.usual)
               for key in curve.fitted]
    more = len(columns)
    source = _shifted(layout.source, old, len(slots))
    groups = layout.groups
    return replace(
        layout, chain=replace(chain, terms=(*chain.terms, name), slots=(*chain.slots, *slots)),
        columns=(*layout.columns[:first], *columns, *layout.columns[first:]),
        source=np.concatenate([source[:first], points, source[first:]]),
        scatters=tuple(place + more if place >= first else place for place in layout.scatters),
        precision=block_diag(np.diag(np.full(more, term.usual**-2.0)), layout.precision),
        centre=np.concatenate([[curve.point(key) for key in curve.fitted], layout.centre]),
        usual=np.concatenate([layout.usual, list(whole.values()), curve.points]),
        groups=groups and replace(groups, inputs=_shifted(groups.inputs, old, len(slots))))


def _shifted(inputs: Int[np.ndarray, " k"], first: int, by: int) -> Int[np.ndarray, " k"]:
    """Numbers of the chain's inputs once `by` slots have come after the `first` ones."""
    return np.where(inputs >= first, inputs + by, inputs)
