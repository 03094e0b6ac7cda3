"""Tests have few shots: they fly in smaller steps of lanes, or half of the time would go to lanes not looked at."""

import pytest

import truearc.sim.infer.likelihood.forward_model


@pytest.fixture(autouse=True, scope="module")
def few_spare_lanes() -> object:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(truearc.sim.infer.likelihood.forward_model, "PAD", 8)
        yield
