"""How right and how honest predictions are: p [n, 2] (two, three) against labels [n, 2]; three lies inside two."""

from typing import NamedTuple

import numpy as np

from truearc.sim import statistics as figures

CUT = 0.5
CLASSES = {"miss": (False, False), "two": (True, False), "three": (True, True)}


class Metrics(NamedTuple):
    """Shares in 0-1, NaN where there is nothing to share.

    `accuracy`: rows whose outcome (of three) is called right. `class_three`, `class_two`: of the rows of that outcome,
    those called right, which is what the paper's "F1" is. `f1_three`, `f1_two`: F1 proper of that outcome against the
    others. `brier`: mean squared error of the probabilities, over rows and both outputs. `ece`: calibration error
    expected over truearc.sim.statistics.BINS equal bins of both outputs' probabilities, that is the mean over
    predictions of |share of hits - mean probability| of their bin.
    """

    accuracy: float
    class_three: float
    class_two: float
    f1_three: float
    f1_two: float
    brier: float
    ece: float


def measure(p: np.ndarray, labels: np.ndarray) -> Metrics:
    """All metrics of predictions p [n, 2] with labels [n, 2] of 0 and 1.

    A row called three but not two has no outcome and is wrong.
    """
    said, was = p >= CUT, labels >= 0.5
    three, two = (_of_class(said, was, outcome) for outcome in ("three", "two"))
    return Metrics(figures.accuracy(p, was), three[0], two[0], three[1], two[1],
                   float(np.mean((p - labels)**2)) if len(p) else float("nan"), calibration_error(p, labels))


def _of_class(said: np.ndarray, was: np.ndarray, outcome: str) -> tuple[float, float]:
    """(share of that outcome called so, F1); F1 is 0 where it is never called rightly, NaN where there is none."""
    called = (said == np.array(CLASSES[outcome])).all(axis=1)
    there = (was == np.array(CLASSES[outcome])).all(axis=1)
    return _share(called[there]), figures.f1(called, there)


def calibration_error(p: np.ndarray, labels: np.ndarray) -> float:
    """Expected calibration error of truearc.sim.statistics, both outputs together; NaN of nothing."""
    return figures.calibration_error(p.ravel(), labels.ravel()) if len(p) else float("nan")


def _share(right: np.ndarray) -> float:
    return float(np.mean(right)) if right.size else float("nan")
