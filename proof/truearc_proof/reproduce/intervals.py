"""Means over repetitions and paired differences, with 95 % intervals."""

from typing import NamedTuple

import numpy as np

from truearc.sim.statistics import student_half

RESAMPLES = 4000


class Interval(NamedTuple):
    """A mean with its 95 % interval by Student's t and by the bootstrap (percentiles), over `n` repetitions."""

    mean: float
    low: float
    high: float
    boot_low: float
    boot_high: float
    n: int


def interval(values: np.ndarray, seed: int = 0) -> Interval:
    """Of one value a repetition; NaN rows are left out, and fewer than two leave the bounds NaN.

    For a paired comparison pass the differences. Repetitions that draw from one pool overlap, so the interval covers
    new draws from these recordings; one that covered new recordings would be wider.
    """
    kept = np.asarray(values, float)[~np.isnan(np.asarray(values, float))]
    if len(kept) < 2:
        mean = float(kept[0]) if len(kept) else float("nan")
        nan = float("nan")
        return Interval(mean, nan, nan, nan, nan, len(kept))
    mean = float(kept.mean())
    half = student_half(kept)
    draws = np.random.default_rng([seed, 35]).integers(0, len(kept), (RESAMPLES, len(kept)))
    boot_low, boot_high = np.percentile(kept[draws].mean(axis=1), [2.5, 97.5])
    return Interval(mean, mean - half, mean + half, float(boot_low), float(boot_high), len(kept))
