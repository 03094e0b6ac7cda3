"""A smaller catalogue, for tests that are not about which of all terms it is: each term is compiled and tested."""

from truearc.sim.physics.catalogue import TERMS
from truearc.sim.physics.term import Term

USUAL = ("gravity", "drag", "magnus", "exit_efficiency")


def few_terms(*names: str) -> list[Term]:
    """The terms that are usually believed, the tracker's, and these."""
    return [term for term in TERMS if term.name in (*USUAL, *names) or term.name.startswith("track_")]
