"""Evidence without physics: Gaussian observations linear in the columns, so that everything has a closed form."""

import numpy as np

from truearc.sim.infer.likelihood.score_table import Column, ScoreTable, make_evidence


def make_linear(slopes: np.ndarray, columns: tuple[Column, ...], precision: np.ndarray,
                observed: np.ndarray | None = None) -> ScoreTable:
    """n shots, each with g unit-variance observations: slopes [n, g, P], observed [n, g] (default zeros)."""
    seen = np.zeros(slopes.shape[:2]) if observed is None else observed
    score = np.einsum("ngp,ng->np", slopes, seen)
    info = np.swapaxes(slopes, 1, 2) @ slopes
    return make_evidence(np.arange(len(slopes)), columns, np.zeros(len(columns)), score, info, None, np.diag(precision),
                         np.zeros(len(precision)), -0.5 * (seen**2).sum(1))


def term(name: str, usual: float = 1.0, stage: str = "launch") -> Column:
    return Column(f"{name}.amount", "term", stage, "along", "1", usual)


def shared(name: str, kind: str = "shared") -> Column:
    return Column(name, kind, "launch", "along", "1", 1.0)
