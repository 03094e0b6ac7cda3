"""Who enters, by the names on the command line; a rival's file is imported when it is asked for."""

from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, cast

from truearc.errors import InputError

if TYPE_CHECKING:
    from truearc_proof.rivals.claim import Rival

OURS = "truearc"
MODULES = {"pysindy-ensemble": "pysindy_ensemble", "pysindy-weak": "pysindy_weak", "odr-bindy": "odr_bindy",
           "gp": "gp", "boosted": "boosted", "argmax": "argmax"}
NEEDS = {"pysindy-ensemble": "pysindy", "pysindy-weak": "pysindy", "gp": "sklearn", "boosted": "sklearn"}
RIVALS = tuple(MODULES)


def find_rival(name: str, find: Callable[[str], object] = find_spec) -> "Rival":
    """The rival of that name; InputError when there is none, or when the package it needs is not installed."""
    if name not in MODULES:
        raise InputError(f"there is no rival {name!r}; there are {', '.join(RIVALS)}")
    package = NEEDS.get(name)
    if package and find(package) is None:
        raise InputError(f"{name} needs {package}: pip install ./proof in a checkout")
    return cast("Rival", import_module(f"truearc_proof.rivals.{MODULES[name]}").answer)


def check_rivals(names: Sequence[str], find: Callable[[str], object] = find_spec) -> tuple[str, ...]:
    """The names, each once; InputError for one that cannot enter."""
    for name in names:
        find_rival(name, find)
    return tuple(dict.fromkeys(names))
