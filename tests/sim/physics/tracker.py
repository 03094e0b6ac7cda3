"""What a tracker sees of a ball, by the catalogue's terms about trackers."""

from typing import Any

from truearc.sim.physics.catalogue import watch_terms
from truearc.sim.physics.term import Values, Vec


def watch(values: Values, position_m: Vec, velocity_m_s: Vec, time_s: Any) -> Vec:
    """Where a tracker says a ball is, in m, that is in truth there time_s after release, by `values` (effective)."""
    for term in watch_terms(values):
        position_m = term.watch(values[term.name], position_m, velocity_m_s, time_s)
    return position_m
