"""Tests have few shots: they fly in smaller steps of lanes, or half of the time would go to lanes not looked at."""

import pytest

import truearc.sim.discover.model.linearization


@pytest.fixture(autouse=True, scope="module")
def few_spare_lanes() -> object:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(truearc.sim.discover.model.linearization, "PAD", 8)
        yield
