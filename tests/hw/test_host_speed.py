"""The measures by which tests in real time tell a slow machine from a defect."""

import time

import pytest

from tests.hw.host_speed import BusSpeed, excuse_stalls, measure_bus
from truearc.hw.protocols import Bus, Frame
from truearc.hw.real.can_bus import open_can
from truearc.hw.real.clock import MonotonicClock


class Late:
    """A bus whose frames arrive late, or of which every tenth is lost."""

    def __init__(self, bus: Bus, by_s: float = 0.0, lossy: bool = False) -> None:
        self.bus, self.by_s, self.lossy = bus, by_s, lossy
        self.waiting: list[tuple[float, Frame]] = []
        self.count = 0

    def write(self, frame: Frame) -> bool:
        self.count += 1
        return self.bus.write(frame) if not (self.lossy and self.count % 10 == 0) else True

    def read(self) -> list[Frame]:
        now = time.monotonic()
        self.waiting += [(now + self.by_s, frame) for frame in self.bus.read()]
        ready = [frame for due, frame in self.waiting if due <= now]
        self.waiting = [one for one in self.waiting if one[0] > now]
        return ready

    def faults(self) -> list:
        return []

    def close(self) -> None:
        self.bus.close()


@pytest.fixture
def ends() -> tuple[Bus, Bus]:
    near, far = (open_can("virtual", "test_host_speed", 1_000_000, MonotonicClock()) for _ in range(2))
    yield near, far
    near.close()
    far.close()


def test_a_bus_that_carries_the_robots_frames_is_fast_enough(ends: tuple[Bus, Bus]) -> None:
    speed = measure_bus(*ends)
    assert (speed.wanted, speed.sent, speed.received) == (1000, 1000, 1000)
    assert speed.slowest_s > 0.0 and (speed.too_slow == "") == (speed.slowest_s <= 0.05)


def test_frames_that_come_late_or_never_are_said(ends: tuple[Bus, Bus]) -> None:
    near, far = ends
    late = measure_bus(near, Late(far, 0.2), 0.1)
    assert late.received == late.sent and "a frame took 0.2" in late.too_slow
    lossy = measure_bus(Late(near, lossy=True), far, 0.1, 0.2)
    assert lossy.too_slow == "host too slow: 20 of 200 frames at 2000 per second lost"
    assert BusSpeed(200, 150, 150, 0.01).too_slow == "host too slow: it sent 150 of 200 frames at 2000 per second"


def test_a_host_that_stalls_is_slow_and_loses_nothing(ends: tuple[Bus, Bus], monkeypatch: pytest.MonkeyPatch) -> None:
    """A queue as long as SocketCAN's (278 frames), and 0.4 s in which nothing is sent or read: 800 frames are due."""
    near, far = ends
    monkeypatch.setattr(far._bus.queue, "maxsize", 278)
    sent = 0

    class Stalling:
        def write(self, frame: Frame) -> bool:
            nonlocal sent
            sent += 1
            time.sleep(0.4 if sent == 100 else 0.0)
            return near.write(frame)

    speed = measure_bus(Stalling(), far)
    assert (speed.sent, speed.received) == (1000, 1000) and near.tally.total() == 0


def test_a_failure_is_excused_only_where_the_machine_stood_still() -> None:
    with pytest.raises(AssertionError, match="defect"), excuse_stalls(limit_s=60.0):
        raise AssertionError("defect")
    said = r"host too slow: it stood still for .* s; defect"
    with pytest.raises(pytest.skip.Exception, match=said), excuse_stalls(limit_s=-1.0):
        time.sleep(0.02)
        raise AssertionError("defect")
    with pytest.raises(KeyError), excuse_stalls(limit_s=-1.0):
        raise KeyError("no assertion")
