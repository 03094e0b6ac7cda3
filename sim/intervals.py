"""Intervals for shares and means."""

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import stdtrit

Z90, Z95 = 1.6448536269514722, 1.959963984540054      # of a normal distribution, two-sided


def wilson(successes: int, trials: int, z: float = Z95) -> tuple[float, float]:
    """Wilson score interval of a binomial share (Wilson 1927); (0, 1) when nothing was tried."""
    if trials == 0:
        return 0.0, 1.0
    share = successes / trials
    centre = share + z * z / (2 * trials)
    spread = z * math.sqrt(share * (1 - share) / trials + z * z / (4 * trials * trials))
    scale = 1 + z * z / trials
    return max(0.0, (centre - spread) / scale), min(1.0, (centre + spread) / scale)


def student_half(values: Sequence[float] | np.ndarray) -> float:
    """Half the width of Student's 95 % interval of the mean of n >= 2 independent values; NaN for fewer."""
    numbers = np.asarray(values, float)
    if len(numbers) < 2:
        return math.nan
    quantile = stdtrit(len(numbers) - 1, 0.975)
    return float(quantile * numbers.std(ddof=1) / math.sqrt(len(numbers)))
