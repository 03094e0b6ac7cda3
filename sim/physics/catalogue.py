"""What could be true: every hypothesis that fit, synth, discovery and the generic tests know."""

from collections.abc import Iterable

from robot.config import BadInput
from sim.physics.term import FlightTerm, Term
from sim.physics.terms.drag import Drag
from sim.physics.terms.gravity import Gravity
from sim.physics.terms.magnus import Magnus

TERMS: tuple[Term, ...] = (Gravity(), Drag(), Magnus())


def find_terms(names: Iterable[str]) -> tuple[Term, ...]:
    """Terms by name, in the catalogue's order; BadInput names the first that there is none of."""
    wanted = set(names)
    known = {term.name for term in TERMS}
    for name in sorted(wanted - known):
        raise BadInput(f"there is no term {name!r}; the catalogue has {', '.join(sorted(known))}")
    return tuple(term for term in TERMS if term.name in wanted)


def flight_terms(names: Iterable[str]) -> tuple[FlightTerm, ...]:
    """Those of the named terms that act in the air."""
    return tuple(term for term in find_terms(names) if isinstance(term, FlightTerm))
