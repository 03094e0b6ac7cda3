"""The rival methods that are run on the same worlds, by their names on the command line.

A rival's module is imported only when that rival is requested.
"""

from importlib import import_module
from typing import TYPE_CHECKING, cast

from truearc.errors import InputError

if TYPE_CHECKING:
    from truearc_proof.rivals.claim import Rival

ANSWERS = {"pysindy-ensemble": "sindy:answer_ensemble", "pysindy-weak": "sindy:answer_weak",
           "gp": "residual:answer_gp", "argmax": "claim:answer_argmax"}
RIVALS = tuple(ANSWERS)


def find_rival(name: str) -> "Rival":
    """Return the rival of that name; InputError if there is none."""
    if name not in ANSWERS:
        raise InputError(f"there is no rival {name!r}; there are {', '.join(RIVALS)}")
    module, _, function = ANSWERS[name].partition(":")
    return cast("Rival", getattr(import_module(f"truearc_proof.rivals.{module}"), function))
