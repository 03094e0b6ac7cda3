"""Scales on which beliefs are about normal: positive parameters by their logarithm, shares lost by what is left."""

from typing import Any

import jax.numpy as jnp
import numpy as np

LINEAR, LOG, LEFT = "linear", "log", "left"
SCALES = (LINEAR, LOG, LEFT)


def to_scale(scale: str, value: Any) -> Any:
    """Of numbers or numpy arrays; linear: itself; log: its logarithm; left: -log(1 - value), of a share lost."""
    if scale == LOG:
        return np.log(value)
    return -np.log1p(-value) if scale == LEFT else value


def from_scale(scale: str, number: Any) -> Any:
    """The inverse of to_scale, of JAX arrays too."""
    if scale == LOG:
        return jnp.exp(number)
    return -jnp.expm1(-number) if scale == LEFT else number


def fits_scale(scale: str, value: float) -> bool:
    """Whether a value has a finite place on the scale."""
    return value > 0.0 if scale == LOG else value < 1.0 or scale != LEFT
