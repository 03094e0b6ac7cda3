"""Inverses of information matrices against other methods of SciPy and NumPy."""

import numpy as np
import pytest
from scipy.linalg import inv

from truearc.sim.matrices import invert


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
