"""What could be true: every hypothesis that fit, synth, discovery and the generic tests know."""

from collections.abc import Iterable, Mapping
from typing import Any

from robot.config import BadInput
from sim.physics.term import (
    AirTerm,
    ArrivalTerm,
    Circumstances,
    FlightTerm,
    InFlight,
    LaunchTerm,
    Parameter,
    SensingTerm,
    Term,
    WatchTerm,
    complete,
)
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


def sensing_terms(names: Iterable[str]) -> tuple[SensingTerm, ...]:
    """Those of the named terms that correct what the robot's sensors say of a configuration."""
    return tuple(term for term in find_terms(names) if isinstance(term, SensingTerm))


def watch_terms(names: Iterable[str]) -> tuple[WatchTerm, ...]:
    """Those of the named terms that are about the tracker."""
    return tuple(term for term in find_terms(names) if isinstance(term, WatchTerm))


def launch_terms(names: Iterable[str]) -> tuple[LaunchTerm, ...]:
    """Those of the named terms that act while the wheels hold the ball."""
    return tuple(term for term in find_terms(names) if isinstance(term, LaunchTerm))


def flight_terms(names: Iterable[str]) -> tuple[InFlight, ...]:
    """Those of the named terms that act in the air, on the ball or on what air it meets."""
    return tuple(term for term in find_terms(names) if isinstance(term, FlightTerm | AirTerm))


def arrival_terms(names: Iterable[str]) -> tuple[ArrivalTerm, ...]:
    """Those of the named terms that are about the target."""
    return tuple(term for term in find_terms(names) if isinstance(term, ArrivalTerm))


def effective(params: Mapping[str, Mapping[str, Any]], circumstances: Circumstances) -> dict[str, dict[str, Any]]:
    """{term: {parameter: value}}, complete, as the terms' hooks take them for shots under these circumstances.

    Numbers of a term that follows a circumstance become arrays like it; BadInput names a term that there is none of.
    """
    return {term.name: term.at_shot(complete(term, params[term.name]), circumstances) for term in find_terms(params)}


def find_parameter(name: str) -> Parameter:
    """The parameter called "term.parameter"; BadInput when the catalogue has none of that name."""
    term_name, _, key = name.partition(".")
    for term in find_terms([term_name]):
        for parameter in term.parameters:
            if parameter.name == key:
                return parameter
    raise BadInput(f"{name}: {term_name} has no such parameter")
