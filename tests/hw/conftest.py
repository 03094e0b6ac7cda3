"""A tiny world, and a clock that is set by hand."""

import pytest

from tests.hw.spinning_plant import SpinningPlant


class SetClock:
    """truearc.hw.protocols.Clock whose time is whatever the test says."""

    def __init__(self) -> None:
        self.t_ns = 0

    def now_ns(self) -> int:
        return self.t_ns

    def sleep_until_ns(self, t_ns: int) -> None:
        self.t_ns = max(self.t_ns, t_ns)


@pytest.fixture
def plant() -> SpinningPlant:
    return SpinningPlant()


@pytest.fixture
def clock() -> SetClock:
    return SetClock()
