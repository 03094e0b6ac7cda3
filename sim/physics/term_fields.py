"""Declarations of a term beside its physics: numbers with priors and sources, instrument, and wording of its size."""

import re
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

# Scales on which beliefs are about normal: positive parameters by their logarithm, shares lost by what is left.
LINEAR, LOG, LEFT = "linear", "log", "left"
SCALES = (LINEAR, LOG, LEFT)

Shown = tuple[float, str]             # factor from the parameter's unit, unit as text with its space
SHARE: Shown = (100.0, " %")
ANGLE: Shown = (1.0, "°")
LENGTH: Shown = (100.0, " cm")
SPEED: Shown = (1.0, " m/s")
NUMBER: Shown = (1.0, "")
SECONDS: Shown = (1.0, " s")


@dataclass(frozen=True)
class Prior:
    """Belief before any shot: normal on one of SCALES, weak, with its reason as text.

    `centre` is a value of the parameter itself, `sd` is on the scale (on "log": the log of a factor).
    """

    scale: str
    centre: float
    sd: float
    reason: str


@dataclass(frozen=True)
class Parameter:
    """One number of a term, looked for from `low` to `high`.

    Attributes:
        unit: A product of m, kg, s, rad, rev, deg with powers, such as "1", "1/s" or "kg m/s2"; a share is "1".
        default: The value that a coefficients file that does not mention it means.
        source: Where the range comes from.
        prior: Belief of a likelihood fit in advance; None: known, and not fitted.
        meaning: The number in a few words, with the sign that a positive one has.
        by_ball: Share by which it differs from one ball to another, one standard deviation; 0: it does not.
        fit_each_ball: Where balls are told apart, each gets a number of its own.
        percent: Reports of a fit show it in per cent.
    """

    name: str
    unit: str
    low: float
    high: float
    default: float
    source: str
    prior: Prior | None = None
    meaning: str = ""
    by_ball: float = 0.0
    fit_each_ball: bool = False
    percent: bool = False


def amplitude(name: str, unit: str, low: float, high: float, *, sd: float, meaning: str, source: str, reason: str,
              scale: str = "linear", centre: float = 0.0, **more: Any) -> tuple[Parameter]:
    """Return the parameters of a term that has only its amplitude, which is 0 by default.

    Args:
        low, high: Range of a search; `source` says where it comes from.
        sd: Of the prior about `centre` on `scale`; `reason` says why.
        more: Further fields of Parameter.
    """
    return (Parameter(name, unit, low, high, 0.0, source, Prior(scale, centre, sd, reason), meaning, **more),)


class Instrument(NamedTuple):
    """What to measure, and with what, to settle a term without a shot.

    id: Snake case, the same for every term that one measurement settles; findings, plans and claims name it by this.
    what: The same as text for people.
    sd: one standard deviation of what a team's tools give of the amplitude, in its unit: assumed, not measured. None:
    no such figure is assumed, so no plan counts on the measurement.
    filmed: By filming the ball; not proposed where its flights were tracked.
    """

    id: str
    what: str
    sd: float | None
    filmed: bool = False


class Phrase(NamedTuple):
    """`more`, `less`: what a positive and a negative amplitude mean; {} takes the size.

    The amplitude times `factor` is in `unit`; `per`: what the size is stated for. rate: the amplitude is a rate, and
    the size its inverse, a time constant, in `unit`.
    """

    more: str
    less: str
    factor: float
    unit: str
    per: str = ""
    rate: bool = False


def either_way(text: str, scale: Shown = NUMBER, per: str = "", rate: bool = False) -> Phrase:
    """Return a phrase whose two directions differ where `text` has alternatives: "the air is {} <denser|thinner>".

    Args:
        text: Takes the size in place of {}.
        scale: Factor and unit in which the size is shown.
        per: That for which the size is stated.
        rate: The amplitude is a rate, shown as its time constant.
    """
    more, less = (re.sub(r"<(.*?)\|(.*?)>", rf"\{side}", text) for side in (1, 2))
    return Phrase(more, less, *scale, per, rate)


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
