"""Shapes that annotations declare are checked, and the other annotations of their modules: the first calls of a test.

Some functions run a hundred thousand times in a test; to check every call would double the time of the whole run.
"""

import functools
import inspect
import sys
from collections import Counter
from pathlib import Path
from types import FunctionType
from typing import Any

MOST_CALLS = 50                       # of one function in one test
MOST_MADE = 1                         # of one function inside another, in one test: to check one takes a millisecond

_calls: Counter[tuple[str, str]] = Counter()
_made: Counter[tuple[str, str]] = Counter()
_let_pass: list[FunctionType] = []


def install() -> None:
    """Have modules that declare shapes of arrays check them, from their import on."""
    import jaxtyping  # not before the environment is set: it imports NumPy
    from jaxtyping import install_import_hook

    root = Path(__file__).parents[1]
    shaped = ["truearc." + ".".join(path.relative_to(root).with_suffix("").parts)
              for path in sorted((root / "sim").rglob("*.py"))
              if "from jaxtyping import" in path.read_text(encoding="utf-8")]
    install_import_hook(shaped, "tests.shape_checks.check")
    jaxtyping.jaxtyped = functools.partial(_first_ones, jaxtyping.jaxtyped)  # what the hook puts before each function


def _first_ones(jaxtyped: Any, *args: Any, **kwargs: Any) -> Any:
    """jaxtyped, which leaves a function inside another one as it is where a test has made it several times."""
    decorated = jaxtyped(*args, **kwargs)
    if args:
        return decorated

    def decorate(function: Any) -> Any:
        name = getattr(function, "__module__", ""), getattr(function, "__qualname__", "")
        if "<locals>" not in name[1]:
            return decorated(function)
        _made[name] += 1
        return decorated(function) if _made[name] <= MOST_MADE else function

    return decorate


def check(stand_in: Any) -> Any:
    """beartype for one of jaxtyping's stand-ins of a function: counts its calls, and ends its checks after some."""
    from beartype import beartype

    checked, name = beartype(stand_in), (stand_in.__module__, stand_in.__qualname__)

    @functools.wraps(checked)
    def counted(*args: Any, **kwargs: Any) -> Any:
        _calls[name] += 1
        if _calls[name] == MOST_CALLS:
            _end_checks(*name)
        return checked(*args, **kwargs)

    return counted


def start_again() -> None:
    """Check all functions again, as at the start of a test."""
    _calls.clear()
    _made.clear()
    while _let_pass:
        vars(_let_pass.pop()).pop("__no_type_check__", None)


def _end_checks(module: str, qualname: str) -> None:
    """Mark a function and what it wraps, as jaxtyping asks at every call; one inside another function goes on."""
    found: Any = sys.modules[module]
    for part in qualname.split("."):
        found = inspect.getattr_static(found, part, None)
    found = found.fget if isinstance(found, property) else found
    while found is not None:
        if isinstance(found, FunctionType):
            found.__no_type_check__ = True              # type: ignore[attr-defined]
            _let_pass.append(found)
        found = getattr(found, "__func__", None) or getattr(found, "__wrapped__", None)
