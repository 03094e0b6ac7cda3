"""Terms of third parties: of installed distributions (entry points truearc.terms) and of files that a user names.

An entry point names a term, a class of one, or an iterable of either; a file defines them at module level:

    [project.entry-points."truearc.terms"]
    hood_flex = "truearc_hoodflex:HoodFlex"
"""

import copyreg
import hashlib
import inspect
import sys
import traceback
from collections.abc import Iterable, Sequence
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from truearc.errors import InputError, PluginError, distribution_of, load_plugin, load_text, place_of
from truearc.sim.physics.term import Term
from truearc.sim.physics.term_check import check_term

GROUP = "truearc.terms"
PREFIX = "truearc_terms_from_"        # of modules made of files, followed by the digest of path and text


def terms_of_distributions(known: Sequence[Term]) -> tuple[Term, ...]:
    """Terms of all entry points of the group, beside the `known` ones.

    Raises:
        InputError: names the distribution and entry point that cannot be loaded, are incomplete, or have a taken name.
    """
    found: list[Term] = []
    for point in sorted(entry_points(group=GROUP), key=lambda point: (distribution_of(point), point.name)):
        where = place_of(point)
        try:
            loaded = load_plugin(point)
        except PluginError as error:
            raise InputError(str(error)) from error
        found += _checked(_as_terms(loaded, where), [*known, *found], where)
    return tuple(found)


def terms_of_file(path: str | Path, known: Iterable[Term]) -> tuple[Term, ...]:
    """Terms that a Python file defines at module level, by classes or instances, beside the `known` ones.

    They can be sent to other processes, which get the file's text along with them.

    Raises:
        InputError: names the file, and the line where it fails; a term that is incomplete, or whose name is taken.
    """
    module = _module_of(str(path), load_text(path))
    found = _checked(_as_terms(terms_in(module), str(path)), list(known), str(path))
    if not found:
        raise InputError(f"{path}: defines no term (a subclass of LaunchTerm, FlightTerm, ... or an instance of one)")
    return found


def terms_in(module: ModuleType) -> list[Any]:
    """Terms at the module's top level, and classes of terms that it defines itself."""
    return [value for value in vars(module).values() if isinstance(value, Term) or _is_own_class(value, module)]


def check_unique(terms: Iterable[Term]) -> None:
    """InputError names the first term whose name another has."""
    seen: set[str] = set()
    for term in terms:
        if term.name in seen:
            raise InputError(f"{type(term).__name__}: there is a term {term.name!r} already; give it another name")
        seen.add(term.name)


def _as_terms(loaded: Any, where: str) -> tuple[Term, ...]:
    """The terms of a term, a class of one, or an iterable of either; each once."""
    parts = loaded if isinstance(loaded, Iterable) and not isinstance(loaded, type) else (loaded,)
    try:
        return tuple(dict.fromkeys(part() if isinstance(part, type) else part for part in parts))
    except Exception as error:
        raise InputError(f"{where}: {type(error).__name__}: {error}") from error


def _checked(found: Sequence[Term], known: Sequence[Term], where: str) -> tuple[Term, ...]:
    try:
        for term in found:
            check_term(term)
        check_unique([*known, *found])
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
    return tuple(found)


def _is_own_class(value: Any, module: ModuleType) -> bool:
    """Whether a class is one of the terms to load; an abstract class whose `name` is not set is a base of others."""
    return (isinstance(value, type) and issubclass(value, Term) and value.__module__ == module.__name__
            and not (inspect.isabstract(value) and "name" not in vars(value)) and not value.__name__.startswith("_"))


def _module_of(path: str, text: str) -> ModuleType:
    """The module that the text makes; the same path and text give the same module, so that its classes stay equal."""
    name = PREFIX + hashlib.sha256(f"{path}\0{text}".encode()).hexdigest()[:16]
    if name in sys.modules:
        return sys.modules[name]
    module = ModuleType(name)
    module.__file__ = path
    sys.modules[name] = module        # dataclasses and pickle look a class's module up there
    try:
        exec(compile(text, path, "exec"), vars(module))
    except Exception as error:
        del sys.modules[name]
        raise InputError(f"{_line_of(error, path)}: {type(error).__name__}: {error}") from error
    for value in vars(module).values():
        if _is_own_class(value, module):
            copyreg.pickle(value, lambda term: (_rebuilt, (path, text, type(term).__qualname__, vars(term))))
    return module


def _line_of(error: Exception, path: str) -> str:
    """path:line of the file's own line that failed."""
    if isinstance(error, SyntaxError) and error.filename == path:
        return f"{path}:{error.lineno}"
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == path]
    return f"{path}:{lines[-1]}" if lines else path


def _rebuilt(path: str, text: str, name: str, state: dict[str, Any]) -> Term:
    """A term of a file in another process."""
    kind: Any = _module_of(path, text)
    for part in name.split("."):
        kind = getattr(kind, part)
    term: Term = object.__new__(kind)
    vars(term).update(state)
    return term
