"""Tests have few shots: they fly in smaller steps of lanes, or half of the time would go to lanes nobody looks at."""

import pytest

import sim.discover.linear


@pytest.fixture(autouse=True, scope="module")
def few_spare_lanes() -> object:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sim.discover.linear, "PAD", 8)
        yield
