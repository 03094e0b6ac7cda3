"""Vectors as three separate arrays: x toward the target, y left, z up.

A component that is the Python float 0.0 is absent, and stays absent through these operations. A flight in the vertical
plane thereby costs two dimensions while every law is written once, for three.
"""

from collections.abc import Iterable
from functools import reduce
from typing import Any, NamedTuple

import jax.numpy as jnp

# Keeps the derivative of a length finite at zero; far below any speed that a double could be added to.
TINY = 1e-200


class Vec(NamedTuple):
    x: Any
    y: Any
    z: Any


def absent(value: Any) -> bool:
    """Whether a component is the literal zero (an array is never absent, whatever is in it)."""
    return isinstance(value, float) and value == 0.0


def plus(a: Any, b: Any) -> Any:
    """a + b of components."""
    if absent(a):
        return b
    return a if absent(b) else a + b


def times(a: Any, b: Any) -> Any:
    """a * b of components."""
    return 0.0 if absent(a) or absent(b) else a * b


def add(a: Vec, b: Vec) -> Vec:
    return Vec(plus(a.x, b.x), plus(a.y, b.y), plus(a.z, b.z))


def total(vectors: Iterable[Vec]) -> Vec:
    return reduce(add, vectors, Vec(0.0, 0.0, 0.0))


def scale(factor: Any, a: Vec) -> Vec:
    return Vec(times(factor, a.x), times(factor, a.y), times(factor, a.z))


def dot(a: Vec, b: Vec) -> Any:
    return plus(plus(times(a.x, b.x), times(a.y, b.y)), times(a.z, b.z))


def cross(a: Vec, b: Vec) -> Vec:
    """a x b, right-handed."""
    return Vec(_minus(times(a.y, b.z), times(a.z, b.y)),
               _minus(times(a.z, b.x), times(a.x, b.z)),
               _minus(times(a.x, b.y), times(a.y, b.x)))


def length(a: Vec) -> Any:
    """|a|, with a finite derivative at zero."""
    return jnp.sqrt(dot(a, a) + TINY)


def axes(velocity: Vec) -> tuple[Vec, Vec, Vec]:
    """Unit vectors along the velocity, across it and up, and to the left; across ones fade as it becomes vertical."""
    flat = velocity.x**2 + velocity.y**2
    speed = jnp.sqrt(flat + velocity.z**2 + 1e-12)
    along = Vec(velocity.x / speed, velocity.y / speed, velocity.z / speed)
    level = jnp.sqrt(along.x**2 + along.y**2 + 1e-6)
    left = Vec(-along.y / level, along.x / level, 0.0 * level)
    up = Vec(-along.z * left.y, along.z * left.x, along.x * left.y - along.y * left.x)
    return along, up, left


def _minus(a: Any, b: Any) -> Any:
    return plus(a, times(-1.0, b))
