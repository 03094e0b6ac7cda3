"""A fit whose named effects have become part of what is fitted."""

from dataclasses import replace

import numpy as np

from truearc.sim.discover.model.baseline_fit import BaselineFit, only_shared
from truearc.sim.discover.model.linearization import ParameterLayout, linearise
from truearc.sim.discover.select.refit import Refit


def promote(fitted: BaselineFit, found: Refit) -> BaselineFit:
    """The fit with the named columns among the shared ones, at the refit's optimum."""
    layout = promoted(fitted.layout, found.names)
    spot = found.spot
    return BaselineFit(fitted.intake, layout, spot, linearise(fitted.intake, layout, spot)[0])


def promoted(layout: ParameterLayout, names: tuple[str, ...]) -> ParameterLayout:
    """The layout with these columns moved from the asked to the shared ones."""
    first = len(layout.columns) - len(layout.precision)
    kept = [k for k in range(first) if layout.columns[k].name not in names]
    inner = only_shared(layout, names)
    shift = len(kept)
    return replace(inner, chain=layout.chain, columns=(*(layout.columns[k] for k in kept), *inner.columns),
                   source=np.concatenate([layout.source[kept], inner.source]),
                   scatters=tuple(place + shift if place >= 0 else -1 for place in inner.scatters))
