"""Figures against scikit-learn's and by hand."""

import numpy as np
import pytest
from sklearn.metrics import brier_score_loss, f1_score, log_loss

from truearc.sim.metrics import calibration_error, figures_of, reliability

RNG = np.random.default_rng(6)
P_TWO = RNG.uniform(size=300)
P = np.stack([P_TWO, P_TWO * RNG.uniform(size=300)], axis=1)
LEVEL = RNG.integers(0, 3, 300)


def test_they_are_scikit_learns() -> None:
    found = figures_of(P, LEVEL)
    classes = np.stack([1.0 - P[:, 0], P[:, 0] - P[:, 1], P[:, 1]], axis=1)
    assert found.log_score == pytest.approx(-log_loss(LEVEL, classes, labels=[0, 1, 2]), abs=1e-6)
    assert found.brier_two == pytest.approx(brier_score_loss(LEVEL >= 1, P[:, 0]))
    assert found.brier_three == pytest.approx(brier_score_loss(LEVEL >= 2, P[:, 1]))
    assert found.f1_three == pytest.approx(f1_score(LEVEL >= 2, P[:, 1] >= 0.5))
    assert found.accuracy == np.mean([(p[0] >= 0.5, p[1] >= 0.5) == (one >= 1, one >= 2)
                                      for p, one in zip(P.tolist(), LEVEL.tolist(), strict=True)])


def test_calibration_error_of_the_perfect_and_of_the_sure_and_wrong() -> None:
    stated = np.repeat([0.25, 0.75], 400)
    true = np.concatenate([np.arange(400) % 4 == 0, np.arange(400) % 4 != 0])
    assert calibration_error(stated, true) == pytest.approx(0.0)
    assert calibration_error(np.ones(10), np.zeros(10, bool)) == 1.0
    table = reliability(stated, true)
    assert table.count.tolist() == [400, 400] and table.came_true.tolist() == [0.25, 0.75]
