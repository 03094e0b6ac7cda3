"""Nothing leaves but what is on the list, and never more often; and who else speaks on the bus."""

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from truearc.hw.bus_rules import KINDS, WINDOW_NS, Allowed, AllowedBus, AllowList, MonitoredBus, allow
from truearc.hw.fault_codes import CAN_OVERRUN, DUPLICATE_ID, FOREIGN_HOST, FRAME_NOT_ALLOWED, FRAME_RATE_EXCEEDED
from truearc.hw.protocols import Frame
from truearc.hw.reason import Reason

TORQUE, QUESTION, SETTING = Frame(0, 0x2E, bytes(8)), Frame(0, 0x20, b"", is_remote=True), Frame(0, 0x2E, b"", True)
LIST = (allow(TORQUE, 3), allow(QUESTION, 1), allow(SETTING, 2))


WIRE = CAN_OVERRUN(bus="wire", frames=1)


class Wire:
    """A bus that hears `frames` and keeps what it is given; full when told so."""

    def __init__(self, *told: Reason) -> None:
        self.told, self.full = list(told), False
        self.frames: list[Frame] = []
        self.sent: list[Frame] = []

    def read(self) -> list[Frame]:
        frames, self.frames = self.frames, []
        return frames

    def write(self, frame: Frame) -> bool:
        self.sent.append(frame)
        return not self.full

    def faults(self) -> list[Reason]:
        return self.told

    def close(self) -> None: ...


@pytest.fixture
def bench(clock):
    wire, tally = Wire(WIRE), Counter()
    return wire, clock, tally, AllowedBus(wire, LIST, clock, tally)


def test_a_list_allows_its_kinds_by_number_whatever_they_say() -> None:
    assert WINDOW_NS == 100_000_000
    with pytest.raises(AttributeError):
        LIST[0].most = 1000
    assert list(LIST) == [Allowed(0x2E, False, False, 8, 3), Allowed(0x20, False, True, 0, 1),
                          Allowed(0x2E, True, False, 0, 2)]
    assert AllowList(()).refuse(TORQUE, 0) and AllowList([replace(LIST[0], most=0)]).refuse(TORQUE, 0)
    assert AllowList(LIST).refuse(TORQUE._replace(data=b"\xff" * 8), 0) is None
    rules = AllowList(LIST)
    assert rules.refuse(QUESTION, 0) is None
    assert rules.refuse(QUESTION, 0) == Reason("frame_rate_exceeded", {"frame": "0x020", "most": 1, "window_s": 0.1})


@given(st.lists(st.tuples(st.sampled_from([TORQUE, QUESTION, SETTING]), st.integers(0, WINDOW_NS // 2)), max_size=60))
def test_no_window_ever_holds_more_than_it_may(asked: list[tuple[Frame, int]]) -> None:
    rules, t_ns = AllowList(LIST), 0
    most = {TORQUE: 3, QUESTION: 1, SETTING: 2}
    sent: list[tuple[Frame, int]] = []
    for frame, pause_ns in asked:
        t_ns += pause_ns
        within = sum(other == frame and t_ns - sent_ns < WINDOW_NS for other, sent_ns in sent)
        why = rules.refuse(frame, t_ns)
        assert (why is None) == (within < most[frame])
        if why is None:
            sent.append((frame, t_ns))
        else:
            assert why == FRAME_RATE_EXCEEDED(frame=frame.name, most=most[frame], window_s=0.1)


frames = st.builds(Frame, st.just(0), st.one_of(st.integers(0, 0x7FF), st.integers(0, 0x1FFFFFFF)),
                   st.binary(max_size=9), st.booleans(), st.booleans())


@given(st.one_of(frames, st.sampled_from([0x2E, 0x20]).flatmap(lambda frame_id: st.builds(
    Frame, st.just(0), st.just(frame_id), st.binary(max_size=9), st.booleans(), st.booleans()))))
def test_what_is_not_listed_to_the_bit_is_refused(frame: Frame) -> None:
    listed = any((frame.arbitration_id, frame.is_extended, frame.is_remote, len(frame.data))
                 == (kind.arbitration_id, kind.is_extended, kind.is_remote, kind.length) for kind in LIST)
    why = AllowList(LIST).refuse(frame, 0)
    wanted = FRAME_NOT_ALLOWED(frame=frame.name, bytes=len(frame.data), remote=frame.is_remote)
    assert why == (None if listed else wanted)


def test_a_refused_frame_is_never_sent_is_counted_and_is_said_once(bench) -> None:
    wire, _, tally, bus = bench
    wrong = TORQUE._replace(arbitration_id=0x7FF)
    assert [bus.write(frame) for frame in (wrong, wrong, TORQUE._replace(data=bytes(4)))] == [False] * 3
    assert wire.sent == [] and tally == {"frames not allowed": 3}
    assert bus.faults() == [WIRE, FRAME_NOT_ALLOWED(frame="0x7ff", bytes=8, remote=False),
                            FRAME_NOT_ALLOWED(frame="0x02e", bytes=4, remote=False)]
    assert bus.faults() == [WIRE]


def test_too_often_is_refused_until_the_window_has_passed(bench) -> None:
    wire, clock, tally, bus = bench
    assert [bus.write(TORQUE) for _ in range(5)] == [True, True, True, False, False]
    clock.t_ns = WINDOW_NS - 1
    assert not bus.write(TORQUE) and bus.write(SETTING)
    clock.t_ns = WINDOW_NS
    assert bus.write(TORQUE) and tally == {"frames not allowed": 3} and len(wire.sent) == 5


def test_a_full_queue_is_the_wires_own_refusal(bench) -> None:
    wire, _, tally, bus = bench
    wire.full, wire.frames = True, [TORQUE]
    assert not bus.write(TORQUE) and not tally and bus.faults() == [WIRE] and bus.read() == [TORQUE]
    assert wire.sent == [TORQUE]


MS, S = 1_000_000, 1_000_000_000
PULSE, KNOWN, OURS = Frame(0, 0x21, bytes(8)), Frame(0, 0x29, bytes(8)), Frame(0, 0x2E, bytes(8))


class Monitored:
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
def monitored(clock) -> Monitored:
    return Monitored(clock)


def test_what_belongs_here_is_passed_on_and_unknown_frames_counted(monitored) -> None:
    assert monitored.hear(PULSE, KNOWN, KNOWN) == [] and not monitored.tally
    assert monitored.bus.write(OURS) and monitored.wire.sent == [OURS] and monitored.bus.faults() == []
    stranger = Frame(0, 0x123, b"")
    assert monitored.hear(stranger, stranger, KNOWN._replace(is_extended=True), KNOWN._replace(is_remote=True)) == []
    assert monitored.tally == {"unknown frames 0x123": 2, "unknown frames 0x00000029": 1, "unknown frames 0x029": 1}


def test_noise_does_not_fill_the_memory(monitored) -> None:
    monitored.hear(*(Frame(0, number, b"", True) for number in range(10 * KINDS)))
    assert len(monitored.tally) == KINDS + 1 and monitored.tally.total() == 10 * KINDS
    assert monitored.tally["unknown frames of other kinds"] == 9 * KINDS


def test_a_frame_that_only_we_send_is_another_host(monitored) -> None:
    fault = FOREIGN_HOST(frame="0x02e")
    assert monitored.hear(OURS) == [fault] and monitored.tally == {"frames of another host": 1}
    monitored.clock.t_ns = S - 1
    assert monitored.hear() == [fault]
    monitored.clock.t_ns = S
    assert monitored.hear() == []


@pytest.mark.parametrize("jitter_ms", [0, 49])
@pytest.mark.parametrize("shift_ms", [1, 30, 50])
def test_two_devices_with_one_id_and_one_alone(monitored, jitter_ms: int, shift_ms: int) -> None:
    def pulses(second: bool) -> list[list[Reason]]:
        begin_ms = monitored.clock.t_ns // MS
        moments = [begin_ms + 100 * k + jitter_ms * (k % 2) for k in range(30)]
        moments += [moment + shift_ms for moment in moments] if second else []
        heard = []
        for moment in sorted(moments):
            monitored.clock.t_ns = moment * MS
            heard.append(monitored.hear(PULSE))
        return heard

    assert not any(pulses(second=False))
    assert pulses(second=True)[-1] == [DUPLICATE_ID(frame="0x021", most=16, window_s=1.0, usual=10)]
    monitored.clock.t_ns += S
    assert not any(pulses(second=False))


def test_a_device_that_falls_silent_is_not_two(monitored) -> None:
    for _ in range(10):
        monitored.clock.t_ns += 100 * MS
        monitored.hear(PULSE)
    monitored.clock.t_ns += 60 * S
    assert monitored.hear() == [] and monitored.hear(PULSE) == []
