"""A tiny world, and a clock that is set by hand."""

import pytest

from tests.hw.spinning_plant import SpinningPlant
from tests.waiting import SetClock


@pytest.fixture
def plant() -> SpinningPlant:
    return SpinningPlant()


@pytest.fixture
def clock() -> SetClock:
    return SetClock()
