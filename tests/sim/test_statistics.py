"""Intervals of shares and means, covariances, and how good probabilities were."""

import numpy as np
import pytest
from scipy.linalg import inv
from scipy.stats import binomtest
from sklearn.metrics import brier_score_loss, f1_score, log_loss

from truearc.sim.statistics import calibration_error, figures_of, invert, reliability, wilson

RNG = np.random.default_rng(6)
P_TWO = RNG.uniform(size=300)
P = np.stack([P_TWO, P_TWO * RNG.uniform(size=300)], axis=1)
LEVEL = RNG.integers(0, 3, 300)


@pytest.mark.parametrize(("k", "n"), [(0, 10), (3, 10), (56, 70), (70, 70), (1, 1000)])
def test_wilson_agrees_with_scipy(k, n):
    ours = binomtest(k, n).proportion_ci(0.95, method="wilson")
    assert wilson(k, n) == pytest.approx((ours.low, ours.high), abs=1e-9)


@pytest.mark.parametrize("spread", [0.0, 6.0])
def test_an_information_matrix_is_inverted_whatever_its_units(spread: float) -> None:
    rng = np.random.default_rng(1)
    slopes = rng.normal(size=(60, 12))
    units = 10.0 ** rng.uniform(-spread, spread, 12)
    there = inv(slopes.T @ slopes) / np.outer(units, units)
    np.testing.assert_allclose(invert(slopes.T @ slopes * np.outer(units, units)), there, rtol=1e-9)


@pytest.mark.parametrize("matrix", [np.diag([1.0, 0.0]), np.array([[1.0, 2.0], [2.0, 1.0]]), np.zeros((3, 3))])
def test_one_that_is_not_positive_definite_has_its_pseudo_inverse(matrix: np.ndarray) -> None:
    np.testing.assert_allclose(invert(matrix), np.linalg.pinv(matrix), atol=1e-12)


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
