"""Effects without a name among what is believed: the points of their curves are fitted like any coefficient."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from truearc.sim.discover.model.linearization import ParameterLayout
from truearc.sim.discover.model.score_table import Column
from truearc.sim.infer.belief import Belief
from truearc.sim.infer.curve import Curve
from truearc.sim.physics.nonparametric import CURVE, find_nameless
from truearc.sim.physics.term import complete


def bent(layout: ParameterLayout, belief: Belief) -> ParameterLayout:
    """The layout with the belief's terms without a name, and the points of their curves among the shared columns."""
    for name, curve in belief.curves.items():
        layout = with_curve(layout, name, belief.coefficients[name], curve)
    return layout


def with_curve(layout: ParameterLayout, name: str, values: Mapping[str, float], curve: Curve) -> ParameterLayout:
    """The layout with the nameless term `name`, its parameters fixed, and the curve's points in front of the shared
    columns; they start where the curve has them."""
    chain, term = layout.chain, find_nameless(name)
    whole = complete(term, values)
    old, first = len(chain.slots), len(layout.columns) - len(layout.precision)
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


def _shifted(inputs: np.ndarray, first: int, by: int) -> np.ndarray:
    """Numbers of the chain's inputs once `by` slots have come after the `first` ones."""
    return np.where(inputs >= first, inputs + by, inputs)
