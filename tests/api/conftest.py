"""One small session for all these tests: the launcher slows down over the day, which no believed term models."""

from pathlib import Path

import pytest

import truearc as ta
from tests.sim.discover.worlds import World, make_outcomes


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("api") / "week"
    ta.save_dataset(path, make_outcomes(World(measured=True, speed_by_battery=0.05), 80, 3))
    return path
