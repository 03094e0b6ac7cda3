"""A table of shots and tracks that are plausible."""

import numpy as np
import pytest

from tests.sim.check.foam import film, season
from truearc.sim.data.dataset import Dataset


@pytest.fixture(scope="module")
def filmed() -> Dataset:
    """Twelve tracks of a foam ball."""
    return film()


@pytest.fixture(scope="module")
def table() -> Dataset:
    """Forty scoring shots over a range of angles."""
    return season(np.random.default_rng(5), 1)[0]
