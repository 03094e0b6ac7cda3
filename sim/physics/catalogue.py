"""What could be true: every hypothesis that fit, synth, discovery and the generic tests know."""

from collections.abc import Iterable

from robot.config import BadInput
from sim.physics.term import FlightTerm, LaunchTerm, Parameter, Term
from sim.physics.terms.drag import Drag
from sim.physics.terms.exit_efficiency import ExitEfficiency
from sim.physics.terms.gravity import Gravity
from sim.physics.terms.magnus import Magnus
from sim.physics.terms.wheel_slip import WheelSlip

# Launch terms act in this order: slip is a matter of the wheels' speed, the loss of what is left of it.
TERMS: tuple[Term, ...] = (WheelSlip(), ExitEfficiency(), Gravity(), Drag(), Magnus())


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


def launch_terms(names: Iterable[str]) -> tuple[LaunchTerm, ...]:
    """Those of the named terms that act while the wheels hold the ball."""
    return tuple(term for term in find_terms(names) if isinstance(term, LaunchTerm))


def find_parameter(name: str) -> Parameter:
    """The parameter called "term.parameter"; BadInput when the catalogue has none of that name."""
    term_name, _, key = name.partition(".")
    for term in find_terms([term_name]):
        for parameter in term.parameters:
            if parameter.name == key:
                return parameter
    raise BadInput(f"{name}: {term_name} has no such parameter")
