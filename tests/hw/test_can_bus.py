"""python-can behind truearc.hw.protocols.Bus: a real virtual bus, a real slcan adapter's line protocol over a
pseudo-terminal.
"""

import errno
import itertools
import os
import queue
import select
import threading
import tty
from collections import Counter

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.hw.spinning_plant import closed_after
from tests.waiting import SetClock, wait_until
from truearc.hw.emulated.serial_link import PtyCable, SlcanAdapter
from truearc.hw.fault_codes import CAN_ADAPTER_ERROR, CAN_BUS_OFF, CAN_OVERRUN, CAN_REOPENED, CAN_SILENT
from truearc.hw.protocols import Frame, LinkLost
from truearc.hw.real import can_bus
from truearc.hw.real.clock import MonotonicClock, make_pauses_s

standard, extended, payloads = st.integers(0, 0x7FF), st.integers(0, 0x1FFFFFFF), st.binary(max_size=8)
frames = st.one_of(st.tuples(standard, payloads).map(lambda drawn: Frame(0, *drawn)),
    st.tuples(extended, payloads).map(lambda drawn: Frame(0, *drawn, is_extended=True)),
    st.tuples(standard, st.integers(0, 8)).map(lambda drawn: Frame(0, drawn[0], bytes(drawn[1]), is_remote=True)),
    st.tuples(extended, st.integers(0, 8)).map(lambda drawn: Frame(0, drawn[0], bytes(drawn[1]), True, True)))


@pytest.fixture(scope="module")
def shared_pair():
    near, far = (can_bus.open_can("virtual", "test_can_bus_shared", 1_000_000, SetClock(42)) for _ in range(2))
    yield near, far
    near.close()
    far.close()


@given(sent=st.lists(frames, max_size=20))
def test_frames_cross_unchanged_and_in_order(shared_pair, sent) -> None:
    near, far = shared_pair
    assert all(near.write(frame) for frame in sent)
    assert far.read() == [frame._replace(t_ns=42) for frame in sent]
    assert near.read() == [] and far.read() == []


@pytest.mark.socketcan
def test_socketcan_round_trip() -> None:
    near, far = (can_bus.open_can("socketcan", "vcan0", 1_000_000, MonotonicClock()) for _ in range(2))
    sent = [Frame(0, 0x29, bytes(8)), Frame(0, 0x070E00C5, b"\x01", True), Frame(0, 0x20, b"", is_remote=True)]
    assert all(near.write(frame) for frame in sent)
    received = [far.receive(10.0) for _ in sent]
    assert [frame._replace(t_ns=0) for frame in received if frame is not None] == sent
    assert all(frame is not None and frame.t_ns > 0 for frame in received) and near.read() == []
    near.close()
    far.close()


def test_error_frames_and_a_full_queue_are_counted(clock) -> None:
    raw = can.Bus(interface="virtual", channel="errors", ignore_config=True)
    bus = can_bus.open_can("virtual", "errors", 1_000_000, clock)
    raw.send(can.Message(arbitration_id=4, is_error_frame=True, data=bytes(8)))
    raw.send(can.Message(arbitration_id=5, data=b"", is_extended_id=False))
    assert [frame.arbitration_id for frame in bus.read()] == [5] and bus.tally["error frames: controller"] == 1
    bus.close()
    raw.shutdown()
    reader = can.Bus(interface="virtual", channel="full", rx_queue_size=1, ignore_config=True)
    bus = can_bus.open_can("virtual", "full", 1_000_000, clock)
    assert bus.write(Frame(0, 1, b"")) and not bus.write(Frame(0, 2, b"")) and bus.tally.total() == 1
    assert reader.recv(0).arbitration_id == 1 and bus.write(Frame(0, 3, b""))
    bus.close()
    reader.shutdown()


@pytest.mark.parametrize("code", [105, 11])           # ENOBUFS, EAGAIN: what socketcan says of a full queue
def test_a_full_kernel_queue_refuses(clock, code: int) -> None:
    bus = can_bus.CanBus(_Failing(can.CanOperationError("Failed to transmit", code)), clock, "CAN socketcan can0")
    assert not bus.write(Frame(0, 1, b""))


@pytest.mark.parametrize("error", [can.CanOperationError("Failed to transmit", 100),      # ENETDOWN
                                   can.CanOperationError("Failed to receive", 19),        # ENODEV
                                   OSError(9, "Bad file descriptor"), ValueError("fileno -1")])
def test_a_dead_adapter_is_a_lost_link(clock, error: Exception) -> None:
    bus = can_bus.CanBus(_Failing(error), clock, "CAN socketcan can0")
    with pytest.raises(LinkLost, match="can0"):
        bus.write(Frame(0, 1, b""))
    with pytest.raises(LinkLost, match="can0"):
        bus.read()


@pytest.mark.parametrize(("interface", "channel"), [("socketcan", "nosuchcan7"), ("slcan", "/dev/nosuchport"),
                                                    ("nosuchinterface", "0")])
def test_what_cannot_be_opened_is_named(clock, interface: str, channel: str) -> None:
    with pytest.raises(LinkLost, match=f"{interface} {channel}"):
        can_bus.open_can(interface, channel, 1_000_000, clock)


@pytest.mark.parametrize(("error", "never"), [
    (OSError(errno.ENODEV, "No such device"), False), (can.CanInitializationError("could not open port"), False),
    (OSError(errno.EAFNOSUPPORT, "no CAN"), True), (can.CanInterfaceNotImplementedError("not supported"), True),
    (NameError("canGetNumberOfChannels"), True), (ImportError("no library"), True), (ValueError("bitrate"), True)])
def test_what_no_adapter_would_open_is_told_from_what_may_come(clock, monkeypatch, error, never):
    def refuse(**options: object) -> None:
        raise error

    monkeypatch.setattr(can, "Bus", refuse)
    with pytest.raises(LinkLost) as raised:
        can_bus.open_can("kvaser", "0", 1_000_000, clock)
    assert isinstance(raised.value, can_bus.NeverOpens) == never
    unknown = isinstance(error, NameError | ImportError)
    assert ("is the driver of this interface installed?" in str(raised.value)) == unknown


@pytest.fixture
def adapter():
    """(file descriptor of the adapter's side, port name) of a raw pseudo-terminal."""
    far, near = os.openpty()
    tty.setraw(near)
    yield far, os.ttyname(near)
    for fd in (far, near):
        try:
            os.close(fd)
        except OSError:
            continue


def read_bytes(far: int, count: int) -> bytes:
    """Of the adapter's end, as they come; less than `count` when no more comes for 2 s."""
    data = b""
    while len(data) < count and select.select([far], [], [], 2.0)[0]:
        data += os.read(far, 100)
    return data


@pytest.mark.parametrize(("code", "advice"), [(errno.EAFNOSUPPORT, "modprobe can_raw"), (errno.ENODEV, "how-to/buses")])
def test_a_missing_kernel_module_or_interface_comes_with_advice(clock, monkeypatch, code: int, advice: str) -> None:
    def refuse(**options: object) -> None:
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(can, "Bus", refuse)
    with pytest.raises(LinkLost, match=rf"CAN socketcan can0.*{advice}"):
        can_bus.open_can("socketcan", "can0", 1_000_000, clock)


def test_slcan_speaks_the_adapters_lines(adapter, clock) -> None:
    far, port = adapter
    bus = can_bus.open_can("slcan", port, 1_000_000, clock)
    said = read_bytes(far, len(b"C\rS8\rO\rO\r")).split(b"\r")
    assert said[:2] == [b"C", b"S8"] and said[-2:] == [b"O", b""]      # closed, 1 Mbit/s, open
    assert bus.write(Frame(0, 0x2E, b"\x00\x00\x80\x3f")) and bus.write(Frame(0, 0x070E00C5, b"\x01", True))
    assert bus.write(Frame(0, 0x20, b"", is_remote=True))
    lines = b"t02E40000803F\rT070E00C5101\rr0200\r"
    assert read_bytes(far, len(lines)) == lines
    assert bus.read() == []                                # nothing there: returns at once
    os.write(far, b"t02980000C03F00000040\rT070E07C56006000000040\r" * 25)
    received = gather(bus, 50)
    assert len(received) == 50
    assert received[0] == Frame(0, 0x29, bytes.fromhex("0000C03F00000040"))
    assert received[49] == Frame(0, 0x070E07C5, bytes.fromhex("006000000040"), True)
    bus.close()


def receive_until(bus, data: bytes) -> list[Frame]:
    """Frames as they come, until one says `data`."""
    frames: list[Frame] = []
    for _ in range(1000):
        frame = bus.receive(0.02)
        frames += [] if frame is None else [frame]
        if frame is not None and frame.data == data:
            break
    return frames


def test_an_adapters_answers_are_waited_out(adapter, clock) -> None:
    far, port = adapter
    bus = can_bus.open_can("slcan", port, 1_000_000, clock, wait_s=0.02)
    os.write(far, b"\r\r\a\rz\rt02980000C03F00000040\rZ\rz\rt0290\r")
    assert receive_until(bus, b"") == [Frame(0, 0x29, bytes.fromhex("0000C03F00000040")), Frame(0, 0x29, b"")]
    bus.close()


@pytest.mark.parametrize("line", [b"r1239", b"R000001239", b"t-0121122", b"TFFFFFFFF0", b"tFFF0",
                                  b"t1239112233445566778899", b"d1239112233445566778899aabb", b"t1", b"tXYZ0",
                                  b"t0291", b"t02918"])
def test_a_line_that_is_none_or_of_a_frame_that_no_wire_carries_is_garbled(line, adapter, clock) -> None:
    """The library makes a message of some of them; a recording of it could not be read back."""
    far, port = adapter
    bus = can_bus.open_can("slcan", port, 1_000_000, clock, wait_s=0.02)
    os.write(far, line + b"\rt029199\r")
    assert receive_until(bus, b"\x99") == [Frame(0, 0x29, b"\x99")] and bus.tally["garbled lines"] >= 1
    bus.close()


def test_bytes_that_are_no_text_are_a_garbled_line_too(adapter, clock) -> None:
    far, port = adapter
    bus = can_bus.open_can("slcan", port, 1_000_000, clock, wait_s=0.02)
    os.write(far, b"t0298\xff\xfe\r")
    for _ in range(500):
        if bus.receive(0.02) is None and bus.tally["garbled lines"]:
            break
    os.write(far, b"t029199\r")
    assert receive_until(bus, b"\x99")[-1] == Frame(0, 0x29, b"\x99") and bus.tally["garbled lines"] >= 1
    bus.close()


def test_an_adapter_that_takes_nothing_refuses(adapter, clock) -> None:
    _, port = adapter
    bus = can_bus.open_can("slcan", port, 1_000_000, clock)
    taken = 0
    while bus.write(Frame(0, 0x2E, bytes(8))):
        taken += 1
    assert 10 < taken < 100_000 and bus.tally == {"frames that found the queue full": 1}
    bus.close()


@pytest.mark.parametrize(("frame_id", "data", "words"), [
    (0x004, "0001000000000000", ("receive overrun",)), (0x004, "0030000000000000", ("error passive",)),
    (0x040, "0000000000000000", ("bus off",)), (0x100, "", ("restarted",)), (0x004, "", ("controller",)),
    (0x0A8, "0000000000000000", ("protocol violation", "no acknowledgement", "bus error")),
    (0x000, "", ("of an unknown kind",))])
def test_error_frames_in_words(frame_id: int, data: str, words: tuple[str, ...]) -> None:
    assert can_bus.error_words(frame_id, bytes.fromhex(data)) == words


def test_a_controller_that_went_bus_off_is_a_lost_link(clock) -> None:
    raw = can.Bus(interface="virtual", channel="bus-off", ignore_config=True)
    bus = can_bus.open_can("virtual", "bus-off", 1_000_000, clock)
    raw.send(can.Message(arbitration_id=0x40, is_error_frame=True, data=bytes(8)))
    with pytest.raises(LinkLost, match="bus-off: bus off"):
        bus.receive(0.1)
    assert bus.tally == {"error frames: bus off": 1}
    bus.close()
    raw.shutdown()


def test_a_bus_off_that_only_the_library_knows_of_is_a_lost_link(clock, monkeypatch) -> None:
    raw = can.Bus(interface="virtual", channel="state", ignore_config=True)
    bus = can_bus.open_can("virtual", "state", 1_000_000, clock)
    error = can.Message(arbitration_id=0x80, is_error_frame=True, data=bytes(8))
    raw.send(error)
    assert bus.receive(0.1) is None
    monkeypatch.setattr(type(raw), "state", can.BusState.ERROR)
    raw.send(error)
    with pytest.raises(LinkLost) as caught:
        bus.receive(0.1)
    assert caught.value.reason == CAN_BUS_OFF(bus="CAN virtual state")
    bus.close()
    raw.shutdown()


class _Failing:
    """What python-can does when the kernel refuses."""

    def __init__(self, error: Exception) -> None:
        self._error = error

    def send(self, message: can.Message, timeout: float) -> None:
        raise self._error

    def recv(self, timeout: float) -> can.Message:
        raise self._error


HELLO = Frame(7, 0x21, bytes(8))


def lost(detail: str) -> LinkLost:
    return LinkLost(CAN_ADAPTER_ERROR(bus="CAN test 0", detail=detail))


class Adapter:
    """As much of a CanBus as is supervised; what is put into `coming` is heard, or raised."""

    name = "CAN test 0"

    def __init__(self) -> None:
        self.coming: queue.Queue[Frame | Exception] = queue.Queue()
        self.sent: list[Frame] = []
        self.dead = self.closed = False

    def receive(self, wait_s: float) -> Frame | None:
        try:
            what = self.coming.get(timeout=wait_s)
        except queue.Empty:
            return None
        if isinstance(what, Exception):
            raise what
        return what

    def write(self, frame: Frame) -> bool:
        if self.dead:
            raise lost("cannot write")
        self.sent.append(frame)
        return True

    def close(self) -> None:
        self.closed = True
        if self.dead:
            raise RuntimeError("a driver that cannot even close")


class Bench:
    """A supervised bus whose adapters come out of `drawer`: an adapter, or what opening it raises; then no more."""

    def __init__(self, clock, *drawer: Adapter | Exception, **how) -> None:
        self.clock, self.tally = clock, Counter()
        self.drawer, self.opened = list(drawer), 0
        self.bus = can_bus.SupervisedBus(self.open, clock, self.tally, **how)

    def close(self) -> None:
        self.bus.close()

    def open(self) -> Adapter:
        self.opened += 1
        what = self.drawer.pop(0) if self.drawer else lost("no such device")
        if isinstance(what, Exception):
            raise what
        return what


def why_lost(bus: can_bus.SupervisedBus) -> str:
    try:
        bus.read()
    except LinkLost as error:
        return str(error)
    return ""


benches = closed_after(Bench, "clock")


def gather(bus: can_bus.CanBus | can_bus.SupervisedBus, count: int) -> list[Frame]:
    frames: list[Frame] = []
    wait_until(lambda: frames.extend(bus.read()) or len(frames) >= count)
    return frames


def test_a_bus_with_a_name_may_come_later(benches) -> None:
    adapter = Adapter()
    bench = benches(lost("not plugged in"), lost("not plugged in"), adapter, name="CAN slcan 0")
    assert bench.bus.name == "CAN slcan 0" and "not plugged in" in why_lost(bench.bus)
    wait_until(lambda: bench.bus.lost is None)
    assert bench.bus.write(Frame(0, 1, b"")) and adapter.sent
    with pytest.raises(LinkLost):
        benches(lost("not plugged in"))
    with pytest.raises(can_bus.NeverOpens):
        benches(can_bus.NeverOpens(lost("no driver").reason), name="CAN slcan 0")


@pytest.mark.parametrize(("trouble", "words"), [
    (lost("unplugged"), "CAN test 0: unplugged"),
    (LinkLost(CAN_BUS_OFF(bus="CAN test 0")), "CAN test 0: bus off"),
    (RuntimeError("a driver's own"), "CAN test 0: RuntimeError: a driver's own")])
def test_lost_and_back_again_without_a_restart(benches, trouble: Exception, words: str) -> None:
    first, second = Adapter(), Adapter()
    bench = benches(first)
    first.coming.put(HELLO)
    gather(bench.bus, 1)
    first.coming.put(trouble)
    wait_until(lambda: why_lost(bench.bus))
    assert first.closed and why_lost(bench.bus) in (words, "CAN test 0: no such device")
    with pytest.raises(LinkLost, match="CAN test 0"):
        bench.bus.write(HELLO)
    bench.drawer.append(second)
    wait_until(lambda: not why_lost(bench.bus))
    assert [fault.code for fault in bench.bus.faults()] == [CAN_REOPENED.name]
    assert bench.bus.write(HELLO) and second.sent == [HELLO]       # whoever must be asked can be asked
    second.coming.put(HELLO)
    assert gather(bench.bus, 1) == [HELLO]
    assert bench.bus.faults() == [] and bench.tally == {"times lost": 1}


def test_a_write_that_finds_the_bus_gone_has_it_opened_again(benches) -> None:
    first, second = Adapter(), Adapter()
    bench = benches(first, RuntimeError("a driver that cannot open"), second)
    first.dead = True
    with pytest.raises(LinkLost, match="cannot write"):
        bench.bus.write(HELLO)
    wait_until(lambda: bench.opened == 3 and not why_lost(bench.bus))
    assert first.closed and bench.bus.write(HELLO) and second.sent == [HELLO]


def test_silence_is_a_loss(benches, clock) -> None:
    first, second = Adapter(), Adapter()
    bench = benches(first, second)
    first.coming.put(HELLO._replace(t_ns=0))
    gather(bench.bus, 1)
    clock.t_ns = can_bus.SILENT_NS
    wait_until(lambda: first.closed)
    wait_until(lambda: bench.opened == 2 and not why_lost(bench.bus))
    (fault,) = bench.bus.faults()
    assert fault == CAN_REOPENED(bus="CAN test 0", cause=CAN_SILENT(bus="CAN test 0", silence_s=1.0))


def test_pauses_grow_until_something_is_heard(benches) -> None:
    taken: list[list[float]] = []

    def record():
        taken.append([])
        for pause_s in make_pauses_s(can_bus.FIRST_S, can_bus.LONGEST_S):
            taken[-1].append(pause_s)
            yield 0.0

    refusals = [lost("not yet")] * 3
    first, mute, second, third = Adapter(), Adapter(), Adapter(), Adapter()
    bench = benches(first, *refusals, mute, *refusals, second, third, pauses=record)
    for adapter in (first, second):
        adapter.coming.put(HELLO)
        adapter.coming.put(lost("unplugged"))
    mute.coming.put(lost("unplugged"))             # opened, and lost again before a word was heard
    third.coming.put(HELLO)
    gather(bench.bus, 1)
    wait_until(lambda: bench.opened == 10)
    growing = list(itertools.islice(make_pauses_s(can_bus.FIRST_S, can_bus.LONGEST_S), 8))
    assert [pauses_s for pauses_s in taken if pauses_s] == [growing, [can_bus.FIRST_S]]


def test_what_the_tick_comes_too_late_for_is_counted_and_is_a_fault(benches) -> None:
    adapter = Adapter()
    bench = benches(adapter, room=10)
    for t_ns in range(15):
        adapter.coming.put(HELLO._replace(t_ns=t_ns))
    wait_until(lambda: bench.tally["frames lost to overrun"] == 5)
    assert bench.bus.faults() == [CAN_OVERRUN(bus="CAN test 0", frames=5)]
    assert [frame.t_ns for frame in bench.bus.read()] == list(range(10)) and bench.bus.faults() == []
    assert can_bus.ROOM >= 2000                                    # a second and more of a busy bus


def test_closing_ends_the_thread_and_lets_go(benches) -> None:
    adapter = Adapter()
    bench = benches(adapter)
    bench.bus.close()
    assert adapter.closed and why_lost(bench.bus) == "CAN test 0: closed"
    assert not any(thread.name == "CAN test 0" for thread in threading.enumerate())


def test_a_serial_adapter_pulled_out_and_put_back(tmp_path) -> None:
    """By its stable name, as /dev/serial/by-id gives one; real pyserial and python-can on real pseudo-terminals."""
    plug, clock, tally = tmp_path / "adapter", MonotonicClock(), Counter()
    adapter = SlcanAdapter(PtyCable(prompt=False))
    plug.symlink_to(adapter.port)
    bus = can_bus.SupervisedBus(
        lambda: can_bus.open_can("slcan", str(plug), 1_000_000, clock, can_bus.WAIT_S, tally), clock, tally)
    for said in (b"\x01", b"\x02"):
        wait_until(lambda plugged=adapter: plugged.read() is not None and plugged.is_open)
        adapter.write(Frame(0, 0x21, said))
        assert [frame.data for frame in gather(bus, 1)] == [said] and bus.faults() == []
        plug.unlink()                 # first: a test beside this one may be given the terminal next
        adapter.close()
        wait_until(lambda: why_lost(bus))
        assert str(plug) in why_lost(bus)
        adapter = SlcanAdapter(PtyCable(prompt=False))
        plug.symlink_to(adapter.port)
    assert tally["times lost"] == 2
    bus.close()
    adapter.close()
