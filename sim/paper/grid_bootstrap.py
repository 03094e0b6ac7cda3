"""How far the chosen pair of the grid would move with other shots of the same kind: resampling of what was recorded."""

from dataclasses import dataclass

import numpy as np

from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.dataset import Shots
from truearc.sim.paper.grid_fit import GridFit, Scoring, count_hits, make_scoring

FLOWN_AT_ONCE = 200_000               # flights of tied pairs worked out together


@dataclass(frozen=True)
class Bootstrap:
    """The pair chosen from each resample: `cd`, `cl` [resamples]; `without_three`: resamples that held no three."""

    cd: np.ndarray
    cl: np.ndarray
    without_three: int
    seed: int

    def interval90(self, name: str) -> tuple[float, float]:
        """5 % and 95 % of `cd` or `cl` over the resamples; nan when there are none."""
        values = self.cd if name == "cd" else self.cl
        if not values.size:
            return float("nan"), float("nan")
        low, high = np.quantile(values, (0.05, 0.95), method="inverted_cdf")
        return float(low), float(high)


def bootstrap_grid(rig: Rig, shots: Shots, fit: GridFit, resamples: int, seed: int) -> Bootstrap:
    """Choose as fit_grid does from `resamples` draws with replacement of the scoring shots, by the labels it found.

    Only deviations at tied pairs are flown again. A draw without a three cannot be chosen from, and is counted.
    """
    scoring = make_scoring(rig, shots)
    count = len(scoring.is_three)
    draws = np.random.default_rng(seed).integers(count, size=(resamples, count))
    weights = np.stack([np.bincount(draw, minlength=count) for draw in draws])
    weights = weights[weights[:, scoring.is_three].any(axis=1)]
    tied = [_tied(fit, scoring, weight) for weight in weights]
    chosen = _choose(scoring, fit.axis, tied, weights[:, scoring.is_three])
    return Bootstrap(chosen[:, 0], chosen[:, 1], resamples - len(weights), seed)


def _tied(fit: GridFit, scoring: Scoring, weight: np.ndarray) -> np.ndarray:
    """Pairs best in threes and among those in twos, as indices of [cl, cd] laid flat."""
    three, two = (part.ravel() for part in count_hits(fit.hits, scoring.is_three, weight, fit.axis.size))
    best = np.flatnonzero(three == three.max())
    tied: np.ndarray = best[two[best] == two[best].max()]
    return tied


def _choose(scoring: Scoring, axis: np.ndarray, tied: list[np.ndarray], weights: np.ndarray) -> np.ndarray:
    """(cd, cl) of each draw: least mean deviation, then median, cd, cl, of its tied pairs."""
    pairs = np.unique(np.concatenate(tied)) if tied else np.zeros(0, int)
    cl, cd = axis[pairs // axis.size], axis[pairs % axis.size]
    block = max(1, FLOWN_AT_ONCE // weights.shape[1])
    parts = [scoring.deviation_m(cd[at:at + block], cl[at:at + block]) for at in range(0, len(pairs), block)]
    deviation_m = np.concatenate(parts) if parts else np.zeros((0, weights.shape[1]))
    chosen = np.zeros((len(tied), 2))
    for draw, (candidates, weight) in enumerate(zip(tied, weights, strict=True)):
        at = np.searchsorted(pairs, candidates)
        drawn_m = np.repeat(deviation_m[at], weight, axis=1)
        order = np.lexsort((cl[at], cd[at], np.median(drawn_m, axis=1), drawn_m.mean(axis=1)))
        chosen[draw] = cd[at][order[0]], cl[at][order[0]]
    return chosen
