"""Numbers that a term has besides its amplitude, such as a time constant, which nobody knows of a surmised term.

They are no columns, for where the amplitude is nought the data say nothing of them. So a refit looks for the likeliest
place of each, and what else it may be is part of the amplitude's doubt.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sim.coefficients import Coefficients
from sim.discover.evidence import Array
from sim.discover.linear import Layout, Spot
from sim.physics.catalogue import find_terms
from sim.physics.scales import from_scale, to_scale
from sim.physics.term import Parameter

PLACES = (-2.0, -1.0, 0.0, 1.0, 2.0)  # standard deviations from the prior's centre, where a number is looked for first
HALVINGS = 3                          # of the distance between places, about the likeliest


@dataclass(frozen=True)
class Further:
    """One such number: its slot in the chain, and what is thought of it."""

    slot: int
    parameter: Parameter

    def put(self, spot: Spot, place: float) -> Spot:
        """The spot with the number so many standard deviations from its prior's centre, within its range."""
        prior = self.parameter.prior
        assert prior is not None
        value = float(from_scale(prior.scale, to_scale(prior.scale, prior.centre) + place * prior.sd))
        values = spot.values.copy()
        values[self.slot] = np.clip(value, self.parameter.low, self.parameter.high)
        return replace(spot, values=values)


def further_numbers(layout: Layout, names: tuple[str, ...]) -> list[Further]:
    """Those of the named terms that have a prior and are not fitted as columns already."""
    columns = {column.name for column in layout.columns}
    terms = find_terms({name.partition(".")[0] for name in names})
    return [Further(layout.chain.slots.index((term.name, one.name)), one) for term in terms
            for one in term.parameters[1:] if one.prior is not None and f"{term.name}.{one.name}" not in columns]


def further_values(layout: Layout, spot: Spot, names: tuple[str, ...]) -> Coefficients:
    """{term: {parameter: value}} of them at a spot."""
    return {layout.chain.slots[one.slot][0]: {one.parameter.name: float(spot.values[one.slot])}
            for one in further_numbers(layout, names)}


def look(nats: Callable[[float], float]) -> tuple[Array, Array, float]:
    """(places [K] that were looked at, in order; how likely each is, with its surroundings; nats of all together).

    nats: what the data say for a place, which the prior is added to.
    """
    found = {place: nats(place) - 0.5 * place**2 for place in PLACES}
    apart = PLACES[1] - PLACES[0]
    for _ in range(HALVINGS):
        best, apart = max(found, key=lambda place: found[place]), 0.5 * apart
        found |= {place: nats(place) - 0.5 * place**2 for place in (best - apart, best + apart)}
    places = np.array(sorted(found))
    value = np.array([found[place] for place in places])
    width = np.gradient(places)
    mass = width * np.exp(value - value.max())
    whole = mass.sum() / np.sqrt(2.0 * np.pi)
    return places, mass / mass.sum(), float(value.max() + np.log(whole))
