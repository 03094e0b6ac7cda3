"""Metrics against scikit-learn and closed forms; intervals against SciPy's."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from sklearn.metrics import brier_score_loss, f1_score, recall_score

from truearc_proof.reproduce.models import calibration_error, interval, measure


def predictions(seed, n=300):
    rng = np.random.default_rng(seed)
    three = rng.random(n)
    p = np.column_stack([three + (1.0 - three) * rng.random(n), three])
    return p, (rng.random((n, 1)) < p).astype(float)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_they_are_what_scikit_learn_says(seed):
    p, labels = predictions(seed)
    found = measure(p, labels)
    said, was = (p >= 0.5).sum(axis=1), labels.sum(axis=1).astype(int)
    assert found.accuracy == pytest.approx(np.mean(said == was))
    for outcome, f1, recall in ((2, found.f1_three, found.class_three), (1, found.f1_two, found.class_two)):
        assert f1 == pytest.approx(f1_score(was == outcome, said == outcome))
        assert recall == pytest.approx(recall_score(was == outcome, said == outcome))
    assert found.brier == pytest.approx(brier_score_loss(labels.ravel(), p.ravel()))


def test_a_row_called_three_but_not_two_is_wrong_whatever_it_was():
    for label in ([0.0, 0.0], [1.0, 0.0], [1.0, 1.0]):
        found = measure(np.array([[0.2, 0.9]]), np.array([label]))
        assert found.accuracy == 0.0


def test_a_perfect_and_a_hopeless_prediction():
    labels = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    assert measure(labels, labels) == (1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0)
    wrong = measure(1.0 - labels, labels)
    assert wrong.accuracy == 0.0 and wrong.brier == 1.0 and wrong.ece == 1.0


def test_what_is_not_there_is_nan_not_zero():
    found = measure(np.array([[0.1, 0.1]]), np.array([[0.0, 0.0]]))
    assert math.isnan(found.class_three) and math.isnan(found.f1_three) and found.accuracy == 1.0
    assert math.isnan(measure(np.zeros((0, 2)), np.zeros((0, 2))).brier)


def test_an_honest_coin_is_calibrated_and_a_boaster_is_off_by_what_he_boasts():
    labels = np.tile([[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]], (50, 1))
    assert calibration_error(np.full(labels.shape, 0.5), labels) == pytest.approx(0.0)
    assert calibration_error(np.full(labels.shape, 0.9), labels) == pytest.approx(0.4)


@settings(deadline=None)
@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=40), st.integers(0, 2**32 - 1))
def test_calibration_error_is_at_most_the_mean_absolute_error(values, seed):
    p = np.column_stack([values, values])
    labels = np.random.default_rng(seed).integers(0, 2, p.shape).astype(float)
    assert 0.0 <= calibration_error(p, labels) <= np.abs(p - labels).mean() + 1e-12


def test_the_interval_is_students_and_the_bootstrap_agrees():
    values = np.random.default_rng(4).normal(0.7, 0.1, 25)
    found = interval(values)
    low, high = stats.t.interval(0.95, 24, loc=values.mean(), scale=stats.sem(values))
    assert (found.low, found.high) == pytest.approx((low, high))
    other = stats.bootstrap((values,), np.mean, method="percentile", n_resamples=9999, rng=1).confidence_interval
    assert (found.boot_low, found.boot_high) == pytest.approx((other.low, other.high), abs=0.005)


def test_an_interval_leaves_nan_out_and_does_not_invent_one():
    assert interval(np.array([0.5, np.nan, 0.7])).n == 2
    alone = interval(np.array([0.5, np.nan]))
    assert alone.mean == 0.5 and math.isnan(alone.low)
