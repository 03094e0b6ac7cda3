"""How likely an outcome is: a normal height at the plane, cut into the classes that the operator can tell apart.

A share LAPSE of outcomes and of measured heights are slips, so that no single one can rule the fit.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import log_ndtr, ndtr

from truearc.robot.config.rig_spec import Target
from truearc.robot.config.schema import InputError
from truearc.sim.data.dataset import Shots
from truearc.sim.infer.likelihood.noise import HEIGHT_M, LAPSE, SLIP_M
from truearc.sim.physics.simulate import MISS, THREE, TWO

Array = np.ndarray
CLASSES = {"miss": 0.0, "two": 1.0, "three": 2.0}
SIDED_SHARE = 0.5                     # of misses (of twos) must have a side before that counts as noted of them
NO_TARGET = Target(0.0)               # of shots whose heights are all measured
FAR_M = 1e3                           # stands for no bound
HALF_LOG_2PI = 0.5 * np.log(2.0 * np.pi)


@dataclass(frozen=True)
class OutcomeObservations:
    """Observations of n heights relative to the target's centre, in m.

    Up to two intervals each: `low`, `high` [n, 2] (an empty one has low = high = inf); `height_m` [n] where the
    height itself was measured (nan elsewhere) and beats the class. `classes` [n]: 0 miss, 1 two, 2 three, nan not
    given. `borders` part low misses, low twos, threes, high twos and high misses; `sided`: of which classes, "miss" or
    "two", it was noted on which side of the centre they were. Most drivers note it of misses alone. slips: a measured
    height may be one.
    """

    low: Float[Array, "n 2"]
    high: Float[Array, "n 2"]
    height_m: Float[Array, " n"]
    classes: Float[Array, " n"]
    borders: Float[Array, " 6"]
    sided: tuple[str, ...]
    slips: bool = True

    @property
    def measured(self) -> Bool[Array, " n"]:
        measured: Array = np.isfinite(self.height_m)
        return measured

    def take(self, index: Int[Array, " k"] | Bool[Array, " n"]) -> "OutcomeObservations":
        """Those of the shots."""
        return replace(self, low=self.low[index], high=self.high[index], height_m=self.height_m[index],
                       classes=self.classes[index])


def see_outcomes(shots: Shots, target: Target | None) -> tuple[Int[Array, " n"], OutcomeObservations]:
    """(rows [n] with a usable outcome, side or height, the observations). A miss to the left or right has no
    information on the height; the side low or high halves what an outcome leaves open, or stands for itself.

    InputError when there are outcomes but no [target] in rig.toml.
    """
    outcome, side = np.array(shots.text("outcome")), np.array(shots.text("side"))
    height_m = shots.number("miss_height_m")
    if (outcome != "").any() and target is None:
        raise InputError("rig.toml: target.centre_height_m: missing key; state the opening in [target]"
                         ": the column outcome is about it")
    aside = np.isin(outcome, ("miss", "")) & np.isin(side, ("left", "right"))
    upright = np.isin(side, ("low", "high")) & (target is not None)
    rows = np.flatnonzero(np.isfinite(height_m) | (((outcome != "") | upright) & ~aside))
    target = target or NO_TARGET
    two, three = target.two_half_height_m, target.three_half_height_m
    bounds = np.array([interval(target, outcome[row], side[row]) for row in rows]).reshape(len(rows), 2, 2)
    bounds[bounds[..., 0] == bounds[..., 1]] = np.inf
    bounds[np.abs(bounds) == FAR_M] *= np.inf
    noted = {name: np.isin(side[(outcome == name) & ~aside], ("low", "high")) for name in ("miss", "two")}
    sided = tuple(name for name, known in noted.items() if len(known) and known.mean() >= SIDED_SHARE)
    borders = np.array([-np.inf, -two, -three, three, two, np.inf])
    classes = np.array([CLASSES.get(outcome[row], np.nan) for row in rows])
    return rows, OutcomeObservations(bounds[..., 0], bounds[..., 1], height_m[rows], classes, borders, sided)


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


def log_likelihood(seen: OutcomeObservations, mean_m: Float[Array, " n"],
                   spread_m: Float[Array, " n"]) -> Float[Array, " n"]:
    """Log-likelihood [n] of what was seen, heights normal(mean_m, spread_m), from the centre."""
    chance = (1.0 - LAPSE) * _chance(seen.low, seen.high, mean_m, spread_m).sum(1) + LAPSE / 3.0
    nats: Array = np.where(seen.measured, _log_height(seen, mean_m, spread_m)[0], np.log(chance))
    return nats


def _log_height(seen: OutcomeObservations, mean_m: Float[Array, " n"],
                spread_m: Float[Array, " n"]) -> tuple[Float[Array, " n"], Float[Array, " n"], Float[Array, " n"]]:
    """(log density, probability of not being a slip, deviation in standard ones) of measured heights [n]."""
    wide = np.hypot(spread_m, HEIGHT_M)
    off = np.where(seen.measured, (seen.height_m - mean_m) / wide, 0.0)
    density = np.log1p(-LAPSE) - 0.5 * off**2 - np.log(wide) - HALF_LOG_2PI
    if not seen.slips:
        return density, np.ones(len(off)), off
    nats = np.logaddexp(density, np.log(LAPSE / SLIP_M))
    return nats, np.exp(density - nats), off


def slopes(seen: OutcomeObservations, mean_m: Float[Array, " n"],
           spread_m: Float[Array, " n"]) -> tuple[Float[Array, " n"], Float[Array, " n"], Float[Array, " n"]]:
    """Derivatives of the log-likelihood [n] by mean_m, by log spread_m, and by metres that all borders move out."""
    chance = (1.0 - LAPSE) * _chance(seen.low, seen.high, mean_m, spread_m).sum(1) + LAPSE / 3.0
    by_mean, by_log, by_width = _chance_slopes(seen.low, seen.high, mean_m, spread_m)
    scale = (1.0 - LAPSE) / chance
    _, sound, off = _log_height(seen, mean_m, spread_m)
    wide = np.hypot(spread_m, HEIGHT_M)
    return (np.where(seen.measured, sound * off / wide, by_mean.sum(1) * scale),
            np.where(seen.measured, sound * (off**2 - 1.0) * (spread_m / wide)**2, by_log.sum(1) * scale),
            np.where(seen.measured, 0.0, by_width.sum(1) * scale))


def information(seen: OutcomeObservations, mean_m: Float[Array, " n"],
                spread_m: Float[Array, " n"]) -> Float[Array, "n 3 3"]:
    """Expected information [n, 3, 3] on what `slopes` differentiates by, over all outcomes that could be told apart; a
    height that is a slip has none."""
    low, high = _all_classes(seen)
    n = len(mean_m)
    chance = np.zeros((n, len(low)))
    slope = np.zeros((n, len(low), 3))
    for k, parts in enumerate(zip(low, high, strict=True)):
        lower, upper = (np.broadcast_to(np.array(part, dtype=float), (n, 2)) for part in parts)
        chance[:, k] = (1.0 - LAPSE) * _chance(lower, upper, mean_m, spread_m).sum(1) + LAPSE / 3.0
        slope[:, k] = (1.0 - LAPSE) * np.stack(_chance_slopes(lower, upper, mean_m, spread_m), axis=-1).sum(1)
    classed = np.einsum("nki,nkj,nk->nij", slope, slope, 1.0 / chance)
    measured = np.zeros((n, 3, 3))
    sound, wide = _log_height(seen, mean_m, spread_m)[1], spread_m**2 + HEIGHT_M**2
    measured[:, 0, 0], measured[:, 1, 1] = sound / wide, 2.0 * sound * (spread_m**2 / wide)**2
    return np.where(seen.measured[:, None, None], measured, classed)


def widened(seen: OutcomeObservations, wider_m: Float[Array, " n"]) -> OutcomeObservations:
    """The same outcomes where all borders lie `wider_m` [n] farther out."""
    low, high = (np.where(np.isfinite(edge), edge + np.sign(edge) * wider_m[:, None], edge)
                 for edge in (seen.low, seen.high))
    return replace(seen, low=low, high=high)


def reopened(seen: OutcomeObservations, wider_m: float) -> OutcomeObservations:
    """The same outcomes of an opening whose half heights are both `wider_m` larger."""
    borders = np.where(np.isfinite(seen.borders), seen.borders + np.sign(seen.borders) * wider_m, seen.borders)
    return replace(widened(seen, np.full(len(seen.low), wider_m)), borders=borders)


def best_class(seen: OutcomeObservations, mean_m: Float[Array, " n"], spread_m: Float[Array, " n"]) -> Int[Array, " n"]:
    """Index [n] of the likeliest of miss, two, three."""
    likeliest: Array = np.argmax(class_chances(seen, mean_m, spread_m), axis=1)
    return likeliest


def class_chances(seen: OutcomeObservations, mean_m: Float[Array, " n"],
                  spread_m: Float[Array, " n"]) -> Float[Array, "n 3"]:
    """Probability [n, 3] of miss, two and three, slips among them."""
    two, three = seen.borders[4], seen.borders[3]
    inside = [ndtr((edge - mean_m) / spread_m) - ndtr((-edge - mean_m) / spread_m) for edge in (two, three)]
    clean = np.stack([1.0 - inside[0], inside[0] - inside[1], inside[1]], axis=1)
    chances: Array = (1.0 - LAPSE) * np.clip(clean, 0.0, 1.0) + LAPSE / 3.0
    return chances


def _all_classes(seen: OutcomeObservations) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
    """Lower and upper bounds of the two intervals of each distinguishable outcome."""
    cells = list(pairwise(map(float, seen.borders)))
    low, high, none = cells[:2], cells[:-3:-1], (np.inf, np.inf)
    pairs = [(cells[2], none)]
    for name, below, above in zip(("miss", "two"), low, high, strict=True):
        pairs += [(below, none), (above, none)] if name in seen.sided else [(below, above)]
    return [(a[0], b[0]) for a, b in pairs], [(a[1], b[1]) for a, b in pairs]


def _chance(low: Float[Array, "n k"], high: Float[Array, "n k"], mean_m: Float[Array, " n"],
            spread_m: Float[Array, " n"]) -> Float[Array, "n k"]:
    """Probability of each interval [n, k], without cancellation in either tail."""
    a, b = ((edge - mean_m[:, None]) / spread_m[:, None] for edge in (low, high))
    flip = a > 0.0
    a, b = np.where(flip, -b, a), np.where(flip, -a, b)
    return np.where(low < high, np.exp(log_ndtr(b)) - np.exp(log_ndtr(a)), 0.0)


def _chance_slopes(low: Float[Array, "n k"], high: Float[Array, "n k"], mean_m: Float[Array, " n"],
                   spread_m: Float[Array, " n"]) -> tuple[Float[Array, "n k"], ...]:
    """Derivatives of the probabilities [n, k] by mean_m, by log spread_m, and by borders moving outwards."""
    a, b = ((edge - mean_m[:, None]) / spread_m[:, None] for edge in (low, high))
    at_a, at_b = _density(a), _density(b)
    weigh_a, weigh_b = (np.where(np.isfinite(edge), edge, 0.0) for edge in (a, b))
    out_a, out_b = (np.where(np.isfinite(edge), np.sign(edge), 0.0) for edge in (low, high))
    return ((at_a - at_b) / spread_m[:, None], weigh_a * at_a - weigh_b * at_b,
            (out_b * at_b - out_a * at_a) / spread_m[:, None])


def _density(z: Float[Array, "n k"]) -> Float[Array, "n k"]:
    """Of the standard normal."""
    density: Array = np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)
    return density
