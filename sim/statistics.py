"""Statistics of shots: intervals for proportions and means, covariance, and measures of predicted probabilities."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import ndtri, stdtrit

from truearc.robot.config.targets import POINTS

Z90, Z95 = (float(ndtri(0.5 + 0.5 * share)) for share in (0.90, 0.95))    # of a normal distribution, two-sided
BINS = 10
POINTS_TWO, POINTS_THREE = POINTS


def wilson(successes: int, trials: int, z: float = Z95) -> tuple[float, float]:
    """Return the Wilson score interval of a binomial proportion (Wilson 1927); (0, 1) without trials."""
    if trials == 0:
        return 0.0, 1.0
    share = successes / trials
    centre = share + z * z / (2 * trials)
    spread = z * math.sqrt(share * (1 - share) / trials + z * z / (4 * trials * trials))
    scale = 1 + z * z / trials
    return max(0.0, (centre - spread) / scale), min(1.0, (centre + spread) / scale)


def student_half(values: Sequence[float] | np.ndarray) -> float:
    """Return half the width of Student's 95 % interval of the mean of n >= 2 independent values; NaN for fewer."""
    numbers = np.asarray(values, float)
    if len(numbers) < 2:
        return math.nan
    return float(stdtrit(len(numbers) - 1, 0.975) * numbers.std(ddof=1) / math.sqrt(len(numbers)))


def invert(information: Float[np.ndarray, "P P"]) -> Float[np.ndarray, "P P"]:
    """Return the covariance of an information matrix; the pseudo-inverse if it is not positive definite.

    By Cholesky, with the diagonal scaled to 1: an eighth of the time of eigenvalues.
    """
    diagonal = np.diag(information)
    if not (diagonal > 0.0).all():
        return np.asarray(np.linalg.pinv(information, hermitian=True))
    scale = diagonal**-0.5
    try:
        root = np.linalg.cholesky(information * np.outer(scale, scale))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.pinv(information, hermitian=True))
    half = np.linalg.inv(root)
    return np.asarray(half.T @ half * np.outer(scale, scale))


class Figures(NamedTuple):
    """Figures of n shots: shares right at p = 0.5, F1 of the three, mean log score (nats), mean squared and calibration
    errors.

    `accuracy`: both p on the right side of 0.5. `brier` and `ece`: mean over both outputs.
    """

    shots: int
    accuracy: float
    f1_three: float
    log_score: float
    brier_two: float
    brier_three: float
    ece_two: float
    ece_three: float

    @property
    def brier(self) -> float:
        return 0.5 * (self.brier_two + self.brier_three)

    @property
    def ece(self) -> float:
        return 0.5 * (self.ece_two + self.ece_three)


@dataclass(frozen=True, eq=False)
class Reliability:
    """Bins of stated probabilities: mean stated, observed proportion, count; empty bins are omitted."""

    stated: np.ndarray
    came_true: np.ndarray
    count: np.ndarray


def figures_of(p: np.ndarray, level: np.ndarray) -> Figures:
    """Return the figures of p [n, 2] (two, three) against level [n] (0 miss, 1 two, 2 three)."""
    hit = np.stack([level >= 1, level >= 2], axis=1)
    said = p >= 0.5
    brier = ((p - hit) ** 2).mean(axis=0)
    return Figures(len(level), accuracy(p, hit), f1(said[:, 1], hit[:, 1]),
                   float(log_scores(p, level).mean()), float(brier[0]), float(brier[1]),
                   *(calibration_error(p[:, k], hit[:, k]) for k in range(2)))


def log_scores(p: np.ndarray, level: np.ndarray) -> np.ndarray:
    """Return the log probability [n] of the outcome among miss, two, three; p_three above p_two counts as p_two."""
    three = np.minimum(p[:, 1], p[:, 0])
    classes = np.maximum(np.stack([1.0 - p[:, 0], p[:, 0] - three, three], axis=1), 1e-9)
    classes /= classes.sum(axis=1, keepdims=True)
    return np.asarray(np.log(classes[np.arange(len(level)), level]))


def reliability(stated: np.ndarray, came_true: np.ndarray, bins: int = BINS) -> Reliability:
    """Compare stated probabilities [n], in even bins from 0 to 1, with outcomes [n]."""
    place = np.clip((stated * bins).astype(int), 0, bins - 1)
    count = np.bincount(place, minlength=bins)
    used = count > 0
    sums = [np.bincount(place, weights=np.asarray(part, float), minlength=bins)[used] for part in (stated, came_true)]
    return Reliability(sums[0] / count[used], sums[1] / count[used], count[used])


def calibration_error(stated: np.ndarray, came_true: np.ndarray, bins: int = BINS) -> float:
    """Return the mean over shots of |stated - observed| of their bin (expected calibration error)."""
    table = reliability(stated, came_true, bins)
    return float((table.count * np.abs(table.stated - table.came_true)).sum() / table.count.sum())


def accuracy(p: np.ndarray, hit: np.ndarray) -> float:
    """Return the share of shots with both p [n, 2] on the right side of 0.5; NaN without shots."""
    return float(((p >= 0.5) == hit).all(axis=1).mean()) if len(p) else float("nan")


def f1(said: np.ndarray, true: np.ndarray) -> float:
    """Return F1 of a class from booleans [n], said and true; NaN if neither occurs."""
    both = float((said & true).sum())
    return 2.0 * both / float(said.sum() + true.sum()) if said.any() or true.any() else float("nan")
