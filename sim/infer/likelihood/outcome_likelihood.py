"""Marks of a shot as likelihoods of the height at the plane (JAX): intervals of an ordinal outcome, measured heights.

Heights are relative to the target's centre, and normal: mean_m and sd_m [n].
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import log_ndtr
from jaxtyping import Bool, Float

from truearc.robot.config.rig_spec import Target
from truearc.sim.physics.simulate import MISS, THREE, TWO
from truearc.sim.physics.term import Opening

# One mark in a hundred is a slip, so that no single one can rule the fit: all three outcomes are then equally likely,
# or all heights within two metres of the centre.
LAPSE = 0.01
LAPSED_OUTCOME = np.log(LAPSE / 3.0)
LAPSED_HEIGHT = np.log(LAPSE / 4.0)
HEIGHT_SD_M = 0.02                    # of a measured height at the plane
HALF_LOG_2PI = 0.5 * np.log(2.0 * np.pi)
FAR_M = 1e3                           # stands for infinity, whose derivatives are not finite


class OutcomeMarks(NamedTuple):
    """Observations at the plane. A height lies in [low_m, high_m] or in [low2_m, high2_m].

    `marked` False: nothing is known. `both`: the second interval counts. `measured` True: height_m instead of these.
    log_lapsed: log density of a measured height that is a slip.
    """

    low_m: Float[Any, " n"]
    high_m: Float[Any, " n"]
    low2_m: Float[Any, " n"]
    high2_m: Float[Any, " n"]
    both: Bool[Any, " n"]
    marked: Bool[Any, " n"]
    measured: Bool[Any, " n"]
    height_m: Float[Any, " n"]
    log_lapsed: Float[Any, " n"]


def make_marks(target: Target, outcome: tuple[str, ...], side: tuple[str, ...],
               miss_height_m: Float[np.ndarray, " n"]) -> OutcomeMarks:
    """Marks [n] of the columns of shots. A measured height counts alone.

    The side low or high halves what an outcome leaves open, or stands for itself where there is none; a ball seen left
    or right of a target that it missed gives no information about the height.
    """
    rows = np.array([interval(target, *words) for words in zip(outcome, side, strict=True)]).reshape(-1, 4)
    low_m, high_m, low2_m, high2_m = rows.T
    measured = np.isfinite(miss_height_m)
    return OutcomeMarks(low_m, high_m, low2_m, high2_m, high2_m > low2_m, (high_m > low_m) | measured, measured,
                 np.where(measured, miss_height_m, 0.0), np.full(len(rows), LAPSED_HEIGHT))


def without_lapses(marks: OutcomeMarks) -> OutcomeMarks:
    """Of which no measured height is a slip: the likelihood then slopes toward a fit of all, however far it is."""
    return marks._replace(log_lapsed=np.full_like(marks.log_lapsed, -FAR_M**2))


def interval(target: Target, outcome: str, side: str) -> tuple[float, float, float, float]:
    """(low, high, low2, high2) in m that the words leave open; both empty (0, 0) without information."""
    inner, outer = target.three_half_height_m, target.two_half_height_m
    nothing = (0.0, 0.0)
    if outcome == THREE:
        return -inner, inner, *nothing
    above = {MISS: (outer, FAR_M), TWO: (inner, outer), "": (0.0, FAR_M)}[outcome]
    below = (-above[1], -above[0])
    if side in ("low", "high"):
        return *(above if side == "high" else below), *nothing
    if outcome == MISS and not side:
        return *below, *above
    if outcome == TWO:
        return (*below, *above) if not side else (-outer, outer, *nothing)
    return *nothing, *nothing


def log_marks(marks: OutcomeMarks, mean_m: Float[Any, " n"], sd_m: Float[Any, " n"]) -> Float[Any, " n"]:
    """Log-likelihood [n] of the marks, lapses included; 0 where there is none."""
    one = log_between(marks.low_m, marks.high_m, mean_m, sd_m)
    two = log_between(jnp.where(marks.both, marks.low2_m, 0.0), jnp.where(marks.both, marks.high2_m, 1.0), mean_m, sd_m)
    inside = jnp.where(marks.both, jnp.logaddexp(one, two), one)
    seen = jnp.logaddexp(np.log1p(-LAPSE) + inside, LAPSED_OUTCOME)
    wide = jnp.sqrt(sd_m**2 + HEIGHT_SD_M**2)
    density = -0.5 * ((marks.height_m - mean_m) / wide)**2 - jnp.log(wide) - HALF_LOG_2PI
    measured = jnp.logaddexp(np.log1p(-LAPSE) + density, marks.log_lapsed)
    return jnp.where(marks.marked, jnp.where(marks.measured, measured, seen), 0.0)


def log_between(low_m: Any, high_m: Any, mean_m: Float[Any, "*n"], sd_m: Float[Any, "*n"]) -> Float[Any, "*n"]:
    """log P(low < height < high), right to the last digits far out in either tail. An empty interval,
    whose value no caller uses, counts as a metre wide."""
    high_m = jnp.where(high_m > low_m, high_m, low_m + 1.0)
    return _log_slice((low_m - mean_m) / sd_m, (high_m - mean_m) / sd_m)


@jax.custom_jvp
def _log_slice(low: Float[Any, "*n"], high: Float[Any, "*n"]) -> Float[Any, "*n"]:
    """log of the standard normal's share between low and high."""
    right = low + high > 0.0
    near, far = jnp.where(right, -low, high), jnp.where(right, -high, low)
    log_near, log_far = log_ndtr(near), log_ndtr(far)
    return log_near + jnp.log(-jnp.expm1(jnp.minimum(log_far - log_near, -1e-15)))


@_log_slice.defjvp
def _slope(at: tuple[Any, Any], change: tuple[Any, Any]) -> tuple[Any, Any]:
    """Densities over the share, in logs; written in terms of the share, so that second derivatives stay as short."""
    value = _log_slice(*at)
    low, high = (jnp.exp(-0.5 * edge**2 - HALF_LOG_2PI - value) for edge in at)
    return value, high * change[1] - low * change[0]


def fit_edges(marks: OutcomeMarks, target: Target, opening: Opening) -> OutcomeMarks:
    """Marks made for the rig's target with their edges where the opening has them."""
    def moved(edge_m: Float[Any, " n"]) -> Float[Any, " n"]:
        size, inner = jnp.abs(edge_m), target.three_half_height_m
        grown = jnp.where(size == inner, opening.three_half_m,
                          jnp.where(size == target.two_half_height_m, opening.two_half_m, size))
        return jnp.sign(edge_m) * grown

    return marks._replace(low_m=moved(marks.low_m), high_m=moved(marks.high_m), low2_m=moved(marks.low2_m),
                          high2_m=moved(marks.high2_m))


def outcome_probabilities(opening: Opening, mean_m: Float[Any, " n"], sd_m: Float[Any, " n"]) -> Float[Any, "n 3"]:
    """P(miss, two, three) [n, 3] of heights relative to the opening's centre, lapses included."""
    three = jnp.exp(log_between(-opening.three_half_m, opening.three_half_m, mean_m, sd_m))
    three = jnp.where(jnp.asarray(opening.three_half_m) > 0.0, three, 0.0)
    two = jnp.exp(log_between(-opening.two_half_m, opening.two_half_m, mean_m, sd_m)) - three
    clean = jnp.stack([1.0 - two - three, two, three], axis=-1)
    return (1.0 - LAPSE) * jnp.clip(clean, 0.0, 1.0) + LAPSE / 3.0
