"""The numbers of a rig apart from the rest of it: code that is compiled for one rig serves every other."""

from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import msgspec
import numpy as np
from jaxtyping import Float

from truearc.robot.config.rig_spec import Rig


def numbers_of(rig: Rig) -> tuple[float, ...]:
    """Every number of a rig, in the order of its fields."""
    return tuple(_leaves(rig))


def with_numbers(rig: Rig, numbers: Iterator[Any]) -> Rig:
    """The rig with its numbers replaced, in the order of numbers_of; they may be traced."""
    put: Rig = _put(rig, numbers)
    return put


@lru_cache(256)
def apart(rig: Rig) -> tuple[Rig, Float[np.ndarray, " numbers"]]:
    """The rig without its numbers, for which code is compiled, and these."""
    numbers = np.array(numbers_of(rig), dtype=float)
    return with_numbers(rig, iter([0.0] * len(numbers))), numbers


def together(rig: Rig, numbers: Any) -> Rig:
    """The rig of both; numbers: traced ones, too."""
    return with_numbers(rig, iter([numbers[k] for k in range(len(numbers))]))


def without_wheels(rig: Rig) -> Rig:
    """The rig for laws of flight, which no wheel is in."""
    return msgspec.structs.replace(rig, launcher=msgspec.structs.replace(rig.launcher, wheel=()))


def _leaves(part: Any) -> Iterator[float]:
    if isinstance(part, float):
        yield part
    elif isinstance(part, msgspec.Struct | tuple):
        for inner in part if isinstance(part, tuple) else msgspec.structs.astuple(part):
            yield from _leaves(inner)


def _put(part: Any, numbers: Iterator[Any]) -> Any:
    if isinstance(part, float):
        return next(numbers)
    if isinstance(part, tuple):
        return tuple(_put(inner, numbers) for inner in part)
    if isinstance(part, msgspec.Struct):
        return type(part)(*(_put(inner, numbers) for inner in msgspec.structs.astuple(part)))
    return part
