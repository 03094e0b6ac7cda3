"""Intervals against SciPy and against published examples."""

import pytest
from scipy.stats import binomtest

from truearc.sim.intervals import wilson
from truearc_proof.table import difference


@pytest.mark.parametrize(("k", "n"), [(0, 10), (3, 10), (56, 70), (70, 70), (1, 1000)])
def test_wilson_agrees_with_scipy(k, n):
    ours = binomtest(k, n).proportion_ci(0.95, method="wilson")
    assert wilson(k, n) == pytest.approx((ours.low, ours.high), abs=1e-9)


def test_newcombe_agrees_with_the_examples_of_his_paper():
    # Newcombe 1998, Statistics in Medicine 17:873, table II, method 10: 56/70 - 48/80 and 9/10 - 3/10
    assert difference((56, 70), (48, 80)) == pytest.approx((0.0524, 0.3339), abs=5e-5)
    assert difference((9, 10), (3, 10)) == pytest.approx((0.1705, 0.8090), abs=5e-5)
