"""The interval of a difference of two shares."""

import math

from truearc.sim.statistics import wilson


def difference(one: tuple[int, int], other: tuple[int, int]) -> tuple[float, float]:
    """Newcombe's hybrid-score 95 % interval of share(one) - share(other), each (successes, trials) (Newcombe 1998)."""
    p, q = _share(*one), _share(*other)
    (p_low, p_high), (q_low, q_high) = wilson(*one), wilson(*other)
    gap = p - q
    return (gap - math.hypot(p - p_low, q_high - q), gap + math.hypot(p_high - p, q - q_low))


def _share(successes: int, trials: int) -> float:
    return successes / trials if trials else 0.5
