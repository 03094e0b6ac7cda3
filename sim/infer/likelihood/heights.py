"""Outcomes of an upright opening: the height at its plane, divided into classes that the operator can distinguish."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import ndtr

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Target
from truearc.sim.data.dataset import Shots
from truearc.sim.infer.likelihood.noise import HEIGHT_M, LAPSE, SLIP_M, SLIP_PER_M
from truearc.sim.infer.likelihood.outcomes import CLASSES, SIDED_SHARE
from truearc.sim.physics.simulate import MISS, THREE, TWO
from truearc.sim.statistics import POINTS_THREE, POINTS_TWO

Array = np.ndarray
NO_TARGET = Target(0.0)               # of shots whose heights are all measured
FAR_M = 1e3                           # stands for no bound
HALF_LOG_2PI = 0.5 * np.log(2.0 * np.pi)
TAIL_SD = 8.0                        # standard deviations: in a normal tail beyond, nothing is left of a double


@dataclass(frozen=True)
class HeightOutcomes:
    """Observations of n heights relative to the target's centre, in m; an implementation of Outcomes.

    Up to two intervals each: `low`, `high` [n, 2] (an empty one has low = high = inf). `borders` part low misses, low
    twos, threes, high twos and high misses. `sided`: of which classes, "miss" or "two", it was noted on which side of
    the centre they were. Most drivers note it of misses alone.
    """

    low: Float[Array, "n 2"]
    high: Float[Array, "n 2"]
    height_m: Float[Array, " n"]
    classes: Float[Array, " n"]
    borders: Float[Array, " 6"]
    sided: tuple[str, ...]
    slips: bool = True
    moves, axes, quantity = 1, 1, "height at the target"

    @property
    def measured(self) -> Bool[Array, " n"]:
        return np.asarray(np.isfinite(self.height_m))

    def take(self, index: Int[Array, " k"] | Bool[Array, " n"]) -> "HeightOutcomes":
        return replace(self, low=self.low[index], high=self.high[index], height_m=self.height_m[index],
                       classes=self.classes[index])

    def without_slips(self) -> "HeightOutcomes":
        return replace(self, slips=False)

    def moves_by(self, slope: Float[Array, "n 4 k"]) -> Float[Array, "n 1 k"]:
        return np.asarray(slope[:, 2:4].mean(1)[:, None])

    def at(self, plane: Float[Array, "n 4"], across_m: Float[Array, "n 2"] | None = None,
           rise: Float[Array, "n 6"] | None = None) -> "HeightOutcomes":
        """Return the same outcomes of the opening that arrival terms make: both half heights as much larger."""
        wider_m = float((plane[:, 3] - self.borders[4]).mean())
        if wider_m == 0.0:
            return self
        borders = np.where(np.isfinite(self.borders), self.borders + np.sign(self.borders) * wider_m, self.borders)
        return replace(self.moved(np.full((len(self.low), 1), wider_m)), borders=borders)

    def moved(self, change: Float[Array, "n 1"]) -> "HeightOutcomes":
        if not change.any():
            return self
        low, high = (np.where(np.isfinite(edge), edge + np.sign(edge) * change, edge) for edge in (self.low, self.high))
        return replace(self, low=low, high=high)

    def log_likelihood(self, mean_m: Float[Array, " n"], spread_m: Float[Array, " n"]) -> Float[Array, " n"]:
        chance = (1.0 - LAPSE) * _chance(self.low, self.high, mean_m, spread_m).sum(1) + LAPSE / 3.0
        return np.asarray(np.where(self.measured, self._log_height(mean_m, spread_m)[0], np.log(chance)))

    def _log_height(self, mean_m: Float[Array, " n"], spread_m: Float[Array, " n"]
                    ) -> tuple[Float[Array, " n"], Float[Array, " n"], Float[Array, " n"]]:
        """(log density, probability of not being a slip, deviation in standard ones) of measured heights [n]."""
        wide = np.hypot(spread_m, HEIGHT_M)
        off = np.where(self.measured, (self.height_m - mean_m) / wide, 0.0)
        density = np.log1p(-LAPSE) - 0.5 * off**2 - np.log(wide) - HALF_LOG_2PI
        if not self.slips:
            return density, np.ones(len(off)), off
        nats = np.logaddexp(density, np.log(LAPSE / SLIP_M))
        return nats, np.exp(density - nats), off

    def slopes_and_information(self, mean_m: Float[Array, " n"], spread_m: Float[Array, " n"],
                               asked: Bool[Array, " 1"] | None = None
                               ) -> tuple[tuple[Float[Array, " n"], ...], Float[Array, "n 3 3"]]:
        return self.slopes(mean_m, spread_m), self.information(mean_m, spread_m)

    def slopes(self, mean_m: Float[Array, " n"], spread_m: Float[Array, " n"]) -> tuple[Float[Array, " n"], ...]:
        chance = (1.0 - LAPSE) * _chance(self.low, self.high, mean_m, spread_m).sum(1) + LAPSE / 3.0
        by_mean, by_log, by_width = (_edge_slopes(self.low, mean_m, spread_m)
                                     - _edge_slopes(self.high, mean_m, spread_m)).sum(2)
        scale = (1.0 - LAPSE) / chance
        _, sound, off = self._log_height(mean_m, spread_m)
        wide = np.hypot(spread_m, HEIGHT_M)
        return (np.where(self.measured, sound * off / wide, by_mean * scale),
                np.where(self.measured, sound * (off**2 - 1.0) * (spread_m / wide)**2, by_log * scale),
                np.where(self.measured, 0.0, by_width * scale))

    def information(self, mean_m: Float[Array, " n"], spread_m: Float[Array, " n"]) -> Float[Array, "n 3 3"]:
        """Return the expected information; a height that is a slip has none."""
        n, cells = len(mean_m), self._cells_of_classes()
        edges = np.broadcast_to(self.borders, (n, len(self.borders)))
        chance = (1.0 - LAPSE) * _chance(edges[:, :-1], edges[:, 1:], mean_m, spread_m) @ cells.T + LAPSE / 3.0
        at_edges = _edge_slopes(edges, mean_m, spread_m)
        by = np.swapaxes((1.0 - LAPSE) * (at_edges[:, :, :-1] - at_edges[:, :, 1:]) @ cells.T, 0, 1)
        classed = (by / chance[:, None]) @ np.swapaxes(by, 1, 2)
        measured = np.zeros((n, 3, 3))
        sound, wide = self._log_height(mean_m, spread_m)[1], spread_m**2 + HEIGHT_M**2
        measured[:, 0, 0], measured[:, 1, 1] = sound / wide, 2.0 * sound * (spread_m**2 / wide)**2
        return np.where(self.measured[:, None, None], measured, classed)

    def class_chances(self, mean_m: Float[Array, " n"], spread_m: Float[Array, " n"],
                      lapses: bool = True) -> Float[Array, "n 3"]:
        inside = [_within(edge, mean_m, spread_m) for edge in (self.borders[4], self.borders[3])]
        clean = np.stack([1.0 - inside[0], inside[0] - inside[1], inside[1]], axis=1)
        clean = np.clip(clean, 0.0, 1.0)
        return np.asarray((1.0 - LAPSE) * clean + LAPSE / 3.0 if lapses else clean)

    def _cells_of_classes(self) -> Float[Array, "k 5"]:
        """1 where a distinguishable outcome is what a height in that cell between two borders leads to."""
        low_miss, low_two, three, high_two, high_miss = np.eye(5)
        found = [three]
        for name, below, above in (("miss", low_miss, high_miss), ("two", low_two, high_two)):
            found += [below, above] if name in self.sided else [below + above]
        return np.stack(found)

    def chance(self, shot: int, mean_m: Any, spread_m: Any, change: Sequence[Any]) -> Any:
        if self.measured[shot]:
            off = np.clip((self.height_m[shot] - mean_m) / spread_m, -38.0, 38.0)      # no underflow
            return np.asarray((1.0 - LAPSE) * np.exp(-0.5 * off**2) / (np.sqrt(2.0 * np.pi) * spread_m)
                              + LAPSE * SLIP_PER_M)
        inner_m = self.borders[3] if self.borders[3] > 0.0 else self.borders[4]
        wider_m = np.maximum(change[0], -inner_m)        # no opening is smaller than nothing
        chance = sum((_tail_share(low, high, mean_m, spread_m, wider_m)
                      for low, high in _intervals(self.low[shot], self.high[shot])), start=np.zeros(()))
        return np.asarray((1.0 - LAPSE) * chance + LAPSE / 3.0)

    def share(self, mean_m: Float[Array, " n"], spread_m: Float[Array, " n"]) -> Float[Array, " n"]:
        return np.asarray(_share(self.low, self.high, mean_m, spread_m).sum(1))

    def hit_chance(self, mean_m: Float[Array, " n"], spread_m: Float[Array, " n"]) -> Float[Array, " n"]:
        two, three = float(self.borders[4]), float(self.borders[3])
        return _within(three if three > 0.0 else two, mean_m, spread_m)      # of a hit-or-miss target a hit counts two

    def centred(self, mean_m: Float[Array, " n"]) -> Float[Array, " n"]:
        return np.zeros_like(mean_m)

    def beside(self, spread_m: Float[Array, " n"], aside: Float[Array, " n"]) -> Float[Array, " n"]:
        return np.asarray(aside * spread_m)

    def points_if_aimed(self, mean_m: Float[Array, " n"],
                        both: Sequence[tuple[Float[Array, " n"], Float[Array, " n"]]]) -> Float[Array, " n"]:
        two, three = float(self.borders[4]), float(self.borders[3])
        aimed, off_m = np.zeros(len(mean_m)), np.abs(self.height_m - mean_m)
        low, high = self.low, self.high
        chance = np.stack([_share(low, high, *one).sum(1) for one in both]) + 1e-12
        for half, points in ((two, POINTS_TWO), (three, POINTS_THREE - POINTS_TWO)):
            inside_low = np.maximum(low, (mean_m - half)[:, None])
            inside_high = np.minimum(high, (mean_m + half)[:, None])
            inside = np.stack([_share(inside_low, inside_high, *one).sum(1) for one in both])
            if half > 0.0:
                aimed += points * np.where(self.measured, off_m <= half, inside.sum(0) / chance.sum(0))
        return np.minimum(aimed, POINTS_THREE)

    def points(self) -> Float[Array, " n"]:
        two, three = self.borders[4], self.borders[3]
        off_m = np.abs(self.height_m)
        level = np.where(np.isfinite(self.classes), self.classes,
                         np.where(off_m <= three, 2.0, np.where(off_m <= two, 1.0, 0.0)))
        return np.asarray(np.choose(level.astype(int), [0.0, POINTS_TWO, POINTS_THREE]))


def see_heights(shots: Shots, target: Target | None) -> tuple[Int[Array, " n"], HeightOutcomes]:
    """Return (rows [n] with a usable outcome, side or height, the observations).

    A miss to the left or right carries no information on the height; the side low or high halves what an outcome
    allows, or is used alone.

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
    return rows, HeightOutcomes(bounds[..., 0], bounds[..., 1], height_m[rows], classes, borders, sided)


def interval(target: Target, outcome: str, side: str) -> tuple[float, float, float, float]:
    """Return (low, high, low2, high2) in m that the words allow; both empty (0, 0) without information."""
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


def _share(low: Float[Array, "n 2"], high: Float[Array, "n 2"], mean_m: Float[Array, " n"],
           spread_m: Float[Array, " n"]) -> Float[Array, "n 2"]:
    """Probability [n, 2] of intervals; of one that ends before it begins: 0."""
    with np.errstate(invalid="ignore"):
        share = (ndtr((high - mean_m[:, None]) / spread_m[:, None])
                 - ndtr((low - mean_m[:, None]) / spread_m[:, None]))
    return np.where(low < high, np.maximum(np.nan_to_num(share), 0.0), 0.0)


def _within(half_m: float, mean_m: Float[Array, " n"], spread_m: Float[Array, " n"]) -> Float[Array, " n"]:
    return np.asarray(ndtr((half_m - mean_m) / spread_m) - ndtr((-half_m - mean_m) / spread_m))


def _intervals(low: Float[Array, " 2"], high: Float[Array, " 2"]) -> Iterator[tuple[float, float]]:
    return ((float(a), float(b)) for a, b in zip(low, high, strict=True) if a < b)


def _tail_share(low: float, high: float, mean_m: Any, spread_m: Any, wider_m: Any) -> Any:
    """Of a normal height between two borders, which lie `wider_m` farther out."""
    below, above = (np.clip((edge + np.sign(edge) * wider_m - mean_m) / spread_m, -TAIL_SD, TAIL_SD)
                    if np.isfinite(edge) else None for edge in (low, high))
    return np.asarray((1.0 if above is None else ndtr(above)) - (0.0 if below is None else ndtr(below)))
