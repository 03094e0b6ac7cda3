"""Argument types of the API, and resolution of terms given by name or as values."""

from collections.abc import Iterable

from truearc.errors import InputError, about
from truearc.sim.physics.catalogue import Catalogue, catalogue
from truearc.sim.physics.term import Term


def check_kind(argument: str, value: object, kind: type | tuple[type, ...], load: str) -> None:
    """Refuse an argument of the wrong type, such as the path of a file that must be loaded first.

    Raises:
        InputError: names the argument, and the function `load` that makes the right type.
    """
    if not isinstance(value, kind):
        raise InputError(f"{argument}: is of type {type(value).__name__}; load it first with truearc.{load}")


def names_of(terms: Iterable[str | Term] | None, argument: str, among: Catalogue) -> tuple[str, ...] | None:
    """Return the terms' names in the given order; None for None.

    Raises:
        InputError: `terms` is a single string or empty, names a term twice, or names one that is not in `among`.
    """
    if terms is None:
        return None
    if isinstance(terms, str):
        raise InputError(f"{argument}: {terms!r} is one string; a list of names is needed")
    names = tuple(term if isinstance(term, str) else term.name for term in terms)
    if not names:
        raise InputError(f"{argument}: names no term")
    if twice := {name for name in names if names.count(name) > 1}:
        raise InputError(f"{argument}: names {', '.join(sorted(twice))} more than once; keep one")
    with about(argument):
        among.find(names)
    return names


def joined(terms: Iterable[str | Term]) -> Catalogue:
    """Return the catalogue extended by the terms that are given as values and not yet in it.

    Raises:
        InputError: a term is incomplete, or another term has its name.
    """
    known = catalogue()
    own = tuple(term for term in terms if isinstance(term, Term) and term not in known.terms)
    return Catalogue((*known.terms, *own)) if own else known
