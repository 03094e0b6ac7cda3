"""Terms by name or as values: what the API's `terms=` and `believe=` take."""

from collections.abc import Iterable

from truearc.robot.config.schema import InputError
from truearc.sim.physics.catalogue import TERMS, find_terms
from truearc.sim.physics.term import Term


def catalogue() -> tuple[Term, ...]:
    """Return every term that fit, discovery and simulation know, in the order in which they act.

    A term is a hypothesis about sensors, launch, flight or target; its `name`, `stage` and `parameters` (with units,
    ranges and sources) describe it.
    """
    return TERMS


def names_of(terms: Iterable[str | Term] | None, argument: str) -> tuple[str, ...] | None:
    """Return the terms' names in the given order; None for None.

    Raises:
        InputError: `terms` is one string or empty, or names a term that the catalogue does not have.
    """
    if terms is None:
        return None
    if isinstance(terms, str):
        raise InputError(f"{argument}: {terms!r} is one string; a list of names is needed")
    names = tuple(term if isinstance(term, str) else term.name for term in terms)
    if not names:
        raise InputError(f"{argument}: names no term")
    try:
        find_terms(names)
    except InputError as error:
        raise InputError(f"{argument}: {error}") from error
    return names


def check_catalogue(terms: Iterable[Term] | None) -> None:
    """Refuse candidate terms other than the catalogue's own.

    Raises:
        InputError: `terms` is not the whole catalogue.
    """
    if terms is not None and set(names_of(tuple(terms), "terms") or ()) != {term.name for term in TERMS}:
        raise InputError("terms: discovery tests the whole catalogue; pass [*catalogue()] or nothing")
