"""Shape parameters of candidate terms, such as a time constant, which are unidentified at zero amplitude.

So they are not columns of the score table. A refit looks for the likeliest place of each, and their uncertainty adds
to that of the amplitude.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from truearc.sim.discover.model.linearization import LinearizationPoint, ParameterLayout
from truearc.sim.infer.coefficients import Coefficients
from truearc.sim.physics.catalogue import find_terms
from truearc.sim.physics.scales import from_scale, to_scale
from truearc.sim.physics.term import Parameter

FARTHEST = 3.0                        # standard deviations from the prior's centre: the end of the search


@dataclass(frozen=True)
class ShapeParameter:
    """One such number: its slot in the chain, and its declaration."""

    slot: int
    parameter: Parameter

    def put(self, spot: LinearizationPoint, place: float) -> LinearizationPoint:
        """The spot with the number `place` standard deviations from its prior's centre, within its range."""
        prior = self.parameter.prior
        assert prior is not None
        value = float(from_scale(prior.scale, to_scale(prior.scale, prior.centre) + place * prior.sd))
        values = spot.values.copy()
        values[self.slot] = np.clip(value, self.parameter.low, self.parameter.high)
        return replace(spot, values=values)


def further_numbers(layout: ParameterLayout, names: tuple[str, ...]) -> list[ShapeParameter]:
    """Those of the named terms that have a prior and are not fitted as columns already."""
    columns = {column.name for column in layout.columns}
    terms = find_terms({name.partition(".")[0] for name in names}, layout.chain.catalogue)
    return [ShapeParameter(layout.chain.slots.index((term.name, one.name)), one) for term in terms
            for one in term.parameters[1:] if one.prior is not None and f"{term.name}.{one.name}" not in columns]


def further_values(layout: ParameterLayout, spot: LinearizationPoint, names: tuple[str, ...]) -> Coefficients:
    """{term: {parameter: value}} of them at a spot."""
    return {layout.chain.slots[one.slot][0]: {one.parameter.name: float(spot.values[one.slot])}
            for one in further_numbers(layout, names)}


@dataclass(frozen=True)
class Peak:
    """Where a number is likeliest, how far it may be from there (one deviation), and the two places beside it that were
    looked at; all in standard deviations from the prior's centre. nats: of all that it may be together."""

    place: float
    sd: float
    beside: tuple[float, float]
    nats: float


def find_peak(nats: Callable[[float], float]) -> Peak:
    """nats: what the data say for a place, which the prior is added to; asked from the centre outwards, then at the top
    of the parabola through the best three."""
    found = {place: nats(place) - 0.5 * place**2 for place in (0.0, -1.0, 1.0)}
    while (best := max(found, key=lambda place: found[place])) in (min(found), max(found)) and abs(best) < FARTHEST:
        further = best + np.copysign(1.0, best)
        found[further] = nats(further) - 0.5 * further**2
    best = min(max(best, min(found) + 1.0), max(found) - 1.0)
    left, middle, right = (found[best + step] for step in (-1.0, 0.0, 1.0))
    bend = max(2.0 * middle - left - right, 1.0)         # no less sure than the prior is
    top = best + float(np.clip(0.5 * (right - left) / bend, -1.0, 1.0))
    value = nats(top) - 0.5 * top**2
    return Peak(top, bend**-0.5, (best - 1.0, best + 1.0), float(value - 0.5 * np.log(bend)))
