"""Who else speaks on the bus."""

from collections import Counter

import pytest

from truearc.hw.bus_rules import KINDS, MonitoredBus
from truearc.hw.fault_codes import DUPLICATE_ID, FOREIGN_HOST
from truearc.hw.protocols import Frame
from truearc.hw.reason import Reason

MS, S = 1_000_000, 1_000_000_000
PULSE, KNOWN, OURS = Frame(0, 0x21, bytes(8)), Frame(0, 0x29, bytes(8)), Frame(0, 0x2E, bytes(8))


class Wire:
    """A bus on which somebody says what a list says."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []
        self.sent: list[Frame] = []

    def read(self) -> list[Frame]:
        frames, self.frames = self.frames, []
        return frames

    def write(self, frame: Frame) -> bool:
        self.sent.append(frame)
        return True

    def faults(self) -> list[Reason]:
        return []

    def close(self) -> None: ...


class Bench:
    def __init__(self, clock) -> None:
        self.wire, self.clock, self.tally = Wire(), clock, Counter()
        self.bus = MonitoredBus(self.wire, [(0x21, False, False), (0x29, False, False)], [(0x2E, False, False)],
                                {(0x21, False, False): 100 * MS}, clock, self.tally)

    def hear(self, *frames: Frame) -> list[Reason]:
        """Faults once these have come in now."""
        self.wire.frames = [frame._replace(t_ns=self.clock.t_ns) for frame in frames]
        assert self.bus.read() == [frame._replace(t_ns=self.clock.t_ns) for frame in frames]
        return self.bus.faults()


@pytest.fixture
def bench(clock) -> Bench:
    return Bench(clock)


def test_what_belongs_here_is_passed_on_and_unknown_frames_counted(bench) -> None:
    assert bench.hear(PULSE, KNOWN, KNOWN) == [] and not bench.tally
    assert bench.bus.write(OURS) and bench.wire.sent == [OURS] and bench.bus.faults() == []
    stranger = Frame(0, 0x123, b"")
    assert bench.hear(stranger, stranger, KNOWN._replace(is_extended=True), KNOWN._replace(is_remote=True)) == []
    assert bench.tally == {"unknown frames 0x123": 2, "unknown frames 0x00000029": 1, "unknown frames 0x029": 1}


def test_noise_does_not_fill_the_memory(bench) -> None:
    bench.hear(*(Frame(0, number, b"", True) for number in range(10 * KINDS)))
    assert len(bench.tally) == KINDS + 1 and bench.tally.total() == 10 * KINDS
    assert bench.tally["unknown frames of other kinds"] == 9 * KINDS


def test_a_frame_that_only_we_send_is_another_host(bench) -> None:
    fault = FOREIGN_HOST(frame="0x02e")
    assert bench.hear(OURS) == [fault] and bench.tally == {"frames of another host": 1}
    bench.clock.t_ns = S - 1
    assert bench.hear() == [fault]
    bench.clock.t_ns = S
    assert bench.hear() == []


@pytest.mark.parametrize("jitter_ms", [0, 49])
@pytest.mark.parametrize("shift_ms", [1, 30, 50])
def test_two_devices_with_one_id_and_one_alone(bench, jitter_ms: int, shift_ms: int) -> None:
    def pulses(second: bool) -> list[list[Reason]]:
        begin_ms = bench.clock.t_ns // MS
        moments = [begin_ms + 100 * k + jitter_ms * (k % 2) for k in range(30)]
        moments += [moment + shift_ms for moment in moments] if second else []
        heard = []
        for moment in sorted(moments):
            bench.clock.t_ns = moment * MS
            heard.append(bench.hear(PULSE))
        return heard

    assert not any(pulses(second=False))
    assert pulses(second=True)[-1] == [DUPLICATE_ID(frame="0x021", most=16, window_s=1.0, usual=10)]
    bench.clock.t_ns += S
    assert not any(pulses(second=False))


def test_a_device_that_falls_silent_is_not_two(bench) -> None:
    for _ in range(10):
        bench.clock.t_ns += 100 * MS
        bench.hear(PULSE)
    bench.clock.t_ns += 60 * S
    assert bench.hear() == [] and bench.hear(PULSE) == []
