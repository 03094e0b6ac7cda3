"""Declared shapes are checked in the tests: tests/conftest.py."""

import numpy as np
import pytest
from jaxtyping import TypeCheckError

from tests.sim.discover.made import heights
from truearc.sim.infer.likelihood.observations import Scatter, best_class


def test_a_field_of_another_shape_is_refused() -> None:
    assert Scatter(np.ones(3), np.zeros(3)).sigma_m.shape == (3,)
    with pytest.raises(TypeCheckError, match="sigma_m"):
        Scatter(np.ones(2), np.zeros(3))


def test_arguments_that_differ_in_length_are_refused() -> None:
    seen = heights(4, np.random.default_rng(0))
    assert best_class(seen, np.zeros(4), np.ones(4)).shape == (4,)
    with pytest.raises(TypeCheckError, match="spread_m"):
        best_class(seen, np.zeros(4), np.ones(5))
