"""What could be true: the hypotheses that fit, synth, discovery and the generic tests know, in the order they act.

A Catalogue is a value that is passed down: to whoever names terms, by name or by themselves. Where none is given, it is
catalogue(): the built-in terms and those of installed distributions (entry points truearc.terms,
truearc.sim.physics.plugins).
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache
from importlib import import_module
from pkgutil import walk_packages
from typing import Any

from truearc.errors import InputError
from truearc.sim.data.conditions import Circumstances
from truearc.sim.physics import terms as built_in
from truearc.sim.physics.nonparametric import CURVE, NAMELESS, POINT
from truearc.sim.physics.plugins import check_unique, terms_in, terms_of_distributions
from truearc.sim.physics.term import STAGES, ArrivalTerm, InFlight, LaunchTerm, SensingTerm, Term, WatchTerm, complete
from truearc.sim.physics.term_check import check_term
from truearc.sim.physics.term_fields import Parameter


@dataclass(frozen=True)
class Catalogue:
    """Terms, each complete, sorted by stage and by the order that they declare within it; names are unique.

    Raises:
        InputError: a term leaves something out, or two have one name.
    """

    terms: tuple[Term, ...]

    def __post_init__(self) -> None:
        for term in self.terms:
            check_term(term)
        check_unique([*NAMELESS, *self.terms])
        ordered = sorted(self.terms, key=lambda term: (STAGES.index(term.stage), term.order[0], term.name))
        object.__setattr__(self, "terms", tuple(ordered))

    def __iter__(self) -> Iterator[Term]:
        return iter(self.terms)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the terms, in their order."""
        return tuple(term.name for term in self.terms)

    @property
    def always(self) -> tuple[str, ...]:
        """Names of terms that are at work in every simulation."""
        return tuple(term.name for term in self.terms if term.always)

    def get(self, name: str) -> Term | None:
        """The term, or the unexplained effect, that is called so; None where there is none."""
        return next((term for term in (*self.terms, *NAMELESS) if term.name == name), None)

    def find(self, names: Iterable[str]) -> tuple[Term, ...]:
        """Terms by name, in the catalogue's order, unexplained effects last.

        Raises:
            InputError: names the first that there is none of.
        """
        wanted = set(names)
        for name in sorted(wanted - {term.name for term in (*self.terms, *NAMELESS)}):
            near = ([one.name for one in self.terms if one.label == name or one.name.startswith(f"{name}_")]
                    or get_close_matches(name, self.names, 1))
            like = f" (did you mean {' or '.join(map(repr, near))}?)" if near else ""
            raise InputError(f"there is no term {name!r}{like}; the catalogue has {', '.join(sorted(self.names))}")
        return tuple(term for term in (*self.terms, *NAMELESS) if term.name in wanted)


# One of each class on the pages of truearc.sim.physics.terms: a new class there is a new term.
BUILT_IN = Catalogue(tuple(kind() for module in walk_packages(built_in.__path__, f"{built_in.__name__}.")
                           for kind in terms_in(import_module(module.name))))
TERMS = BUILT_IN.terms


@cache
def catalogue() -> Catalogue:
    """The built-in terms and those of installed distributions, which are looked for once, when first needed.

    Raises:
        InputError: names the distribution whose terms cannot be loaded, are incomplete, or have a name that is taken.
    """
    return Catalogue((*TERMS, *terms_of_distributions(TERMS)))


def as_catalogue(terms: Iterable[Term] | None) -> Catalogue:
    """These terms, or catalogue() where none are given. InputError as Catalogue."""
    if terms is None:
        return catalogue()
    return terms if isinstance(terms, Catalogue) else Catalogue(tuple(terms))


def find_terms(names: Iterable[str], among: Catalogue | None = None) -> tuple[Term, ...]:
    """As Catalogue.find; among: the catalogue, catalogue() when not given, here and below."""
    return as_catalogue(among).find(names)


def sensing_terms(names: Iterable[str], among: Catalogue | None = None) -> tuple[SensingTerm, ...]:
    """Those of the named terms that correct what the robot's sensors say of a configuration."""
    return tuple(term for term in find_terms(names, among) if isinstance(term, SensingTerm))


def watch_terms(names: Iterable[str], among: Catalogue | None = None) -> tuple[WatchTerm, ...]:
    """Those of the named terms that are about the tracker."""
    return tuple(term for term in find_terms(names, among) if isinstance(term, WatchTerm))


def launch_terms(names: Iterable[str], among: Catalogue | None = None) -> tuple[LaunchTerm, ...]:
    """Those of the named terms that act while the wheels hold the ball."""
    return tuple(term for term in find_terms(names, among) if isinstance(term, LaunchTerm))


def flight_terms(names: Iterable[str], among: Catalogue | None = None) -> tuple[InFlight, ...]:
    """Those of the named terms that act in the air, on the ball or on what air it meets."""
    return tuple(term for term in find_terms(names, among) if isinstance(term, InFlight))


def arrival_terms(names: Iterable[str], among: Catalogue | None = None) -> tuple[ArrivalTerm, ...]:
    """Those of the named terms that are about the target."""
    return tuple(term for term in find_terms(names, among) if isinstance(term, ArrivalTerm))


def effective(params: Mapping[str, Mapping[str, Any]], circumstances: Circumstances,
              among: Catalogue | None = None) -> dict[str, dict[str, Any]]:
    """{term: {parameter: value}}, complete, as the terms' hooks take them for shots under these circumstances.

    Numbers of a term that follows a circumstance become arrays like it; InputError names a term that there is none of.
    """
    return {term.name: dict(term.at_shot(complete(term, params[term.name]), circumstances))
            for term in find_terms(params, among)}


def find_parameter(name: str, among: Catalogue | None = None) -> Parameter:
    """The parameter called "term.parameter", or a curve's point; InputError when the catalogue has none of that
    name."""
    term_name, _, key = name.partition(".")
    if term_name == CURVE:
        return POINT
    (term,) = find_terms([term_name], among)
    for parameter in term.parameters:
        if parameter.name == key:
            return parameter
    raise InputError(f"{name}: {term_name} has no such parameter")
