"""How likely an outcome is: a normal height at the plane, cut into the classes that the operator can tell apart.

A share LAPSE of outcomes and of measured heights are slips, so that no single one can rule the fit.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import ndtr

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Target
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
    by_mean, by_log, by_width = (_edge_slopes(seen.low, mean_m, spread_m)
                                 - _edge_slopes(seen.high, mean_m, spread_m)).sum(2)
    scale = (1.0 - LAPSE) / chance
    _, sound, off = _log_height(seen, mean_m, spread_m)
    wide = np.hypot(spread_m, HEIGHT_M)
    return (np.where(seen.measured, sound * off / wide, by_mean * scale),
            np.where(seen.measured, sound * (off**2 - 1.0) * (spread_m / wide)**2, by_log * scale),
            np.where(seen.measured, 0.0, by_width * scale))


def information(seen: OutcomeObservations, mean_m: Float[Array, " n"],
                spread_m: Float[Array, " n"]) -> Float[Array, "n 3 3"]:
    """Expected information [n, 3, 3] on what `slopes` differentiates by, over all outcomes that could be told apart; a
    height that is a slip has none."""
    n, cells = len(mean_m), _cells_of_classes(seen)
    edges = np.broadcast_to(seen.borders, (n, len(seen.borders)))
    chance = (1.0 - LAPSE) * _chance(edges[:, :-1], edges[:, 1:], mean_m, spread_m) @ cells.T + LAPSE / 3.0
    at_edges = _edge_slopes(edges, mean_m, spread_m)
    slope = (1.0 - LAPSE) * (at_edges[:, :, :-1] - at_edges[:, :, 1:]) @ cells.T
    by = np.swapaxes(slope, 0, 1)
    classed = (by / chance[:, None]) @ np.swapaxes(by, 1, 2)
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


def _cells_of_classes(seen: OutcomeObservations) -> Float[Array, "k 5"]:
    """1 where a distinguishable outcome is what a height in that cell between two borders leads to."""
    low_miss, low_two, three, high_two, high_miss = np.eye(5)
    found = [three]
    for name, below, above in (("miss", low_miss, high_miss), ("two", low_two, high_two)):
        found += [below, above] if name in seen.sided else [below + above]
    return np.stack(found)


def _chance(low: Float[Array, "n k"], high: Float[Array, "n k"], mean_m: Float[Array, " n"],
            spread_m: Float[Array, " n"]) -> Float[Array, "n k"]:
    """Probability of each interval [n, k], without cancellation in either tail."""
    a, b = ((edge - mean_m[:, None]) / spread_m[:, None] for edge in (low, high))
    flip = a > 0.0
    a, b = np.where(flip, -b, a), np.where(flip, -a, b)
    return np.where(low < high, ndtr(b) - ndtr(a), 0.0)


def _edge_slopes(edge: Float[Array, "n k"], mean_m: Float[Array, " n"],
                 spread_m: Float[Array, " n"]) -> Float[Array, "3 n k"]:
    """Derivatives of the probability [n, k] above each edge by mean_m, by log spread_m, and by borders moving outwards;
    of that between two edges they are the lower's less the upper's."""
    z = (edge - mean_m[:, None]) / spread_m[:, None]
    density = np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi)
    by_mean = density / spread_m[:, None]
    bounded = np.isfinite(edge)
    return np.stack([by_mean, np.where(bounded, z, 0.0) * density, np.where(bounded, -np.sign(edge), 0.0) * by_mean])
