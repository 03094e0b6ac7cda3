"""A bus that is lost and comes back: adapters that fail on demand, and a pseudo-terminal that is pulled out."""

import itertools
import queue
import threading
from collections import Counter

import pytest

from truearc.hw.emulated.pty_cable import PtyCable
from truearc.hw.emulated.serial_link import SlcanAdapter
from truearc.hw.fault_codes import CAN_ADAPTER_ERROR, CAN_BUS_OFF, CAN_OVERRUN, CAN_REOPENED, CAN_SILENT
from truearc.hw.protocols import Frame, LinkLost
from truearc.hw.real.can_bus import FIRST_S, LONGEST_S, ROOM, SILENT_NS, WAIT_S, NeverOpens, SupervisedBus, open_can
from truearc.hw.real.clock import MonotonicClock, make_pauses_s

HELLO = Frame(7, 0x21, bytes(8))
PATIENCE_S = 20.0


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
        self.bus = SupervisedBus(self.open, clock, self.tally, **how)

    def open(self) -> Adapter:
        self.opened += 1
        what = self.drawer.pop(0) if self.drawer else lost("no such device")
        if isinstance(what, Exception):
            raise what
        return what


def eventually(true) -> None:
    """Wait until it is: threads take the time that they take."""
    pause = threading.Event()
    for _ in range(int(PATIENCE_S / 0.005)):
        if true():
            return
        pause.wait(0.005)
    raise AssertionError("it never came")


def why_lost(bus: SupervisedBus) -> str:
    try:
        bus.read()
    except LinkLost as error:
        return str(error)
    return ""


@pytest.fixture
def benches(clock):
    made: list[Bench] = []

    def make(*drawer: Adapter | Exception, **how) -> Bench:
        made.append(Bench(clock, *drawer, **how))
        return made[-1]

    yield make
    for bench in made:
        bench.bus.close()


def gather(bus: SupervisedBus, count: int) -> list[Frame]:
    frames: list[Frame] = []
    eventually(lambda: frames.extend(bus.read()) or len(frames) >= count)
    return frames


def test_a_bus_with_a_name_may_come_later(benches) -> None:
    adapter = Adapter()
    bench = benches(lost("not plugged in"), lost("not plugged in"), adapter, name="CAN slcan 0")
    assert bench.bus.name == "CAN slcan 0" and "not plugged in" in why_lost(bench.bus)
    eventually(lambda: bench.bus.lost is None)
    assert bench.bus.write(Frame(0, 1, b"")) and adapter.sent
    with pytest.raises(LinkLost):
        benches(lost("not plugged in"))
    with pytest.raises(NeverOpens):
        benches(NeverOpens(lost("no driver").reason), name="CAN slcan 0")


def test_frames_come_in_order_with_the_stamps_of_their_arrival(benches) -> None:
    adapter = Adapter()
    bench = benches(adapter)
    sent = [HELLO._replace(t_ns=t_ns) for t_ns in range(100)]
    for frame in sent:
        adapter.coming.put(frame)
    assert gather(bench.bus, 100) == sent and bench.bus.read() == []
    assert bench.bus.write(HELLO) and adapter.sent == [HELLO] and bench.bus.faults() == [] and not bench.tally


def test_a_bus_that_cannot_be_opened_at_first_is_an_error_at_once(clock) -> None:
    with pytest.raises(LinkLost, match="no such device"):
        Bench(clock)


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
    eventually(lambda: why_lost(bench.bus))
    assert first.closed and why_lost(bench.bus) in (words, "CAN test 0: no such device")
    with pytest.raises(LinkLost, match="CAN test 0"):
        bench.bus.write(HELLO)
    bench.drawer.append(second)
    eventually(lambda: not why_lost(bench.bus))
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
    eventually(lambda: bench.opened == 3 and not why_lost(bench.bus))
    assert first.closed and bench.bus.write(HELLO) and second.sent == [HELLO]


def test_silence_is_a_loss(benches, clock) -> None:
    first, second = Adapter(), Adapter()
    bench = benches(first, second)
    first.coming.put(HELLO._replace(t_ns=0))
    gather(bench.bus, 1)
    clock.t_ns = SILENT_NS
    eventually(lambda: first.closed)
    eventually(lambda: bench.opened == 2 and not why_lost(bench.bus))
    (fault,) = bench.bus.faults()
    assert fault == CAN_REOPENED(bus="CAN test 0", cause=CAN_SILENT(bus="CAN test 0", silence_s=1.0))


def test_pauses_grow_to_a_limit() -> None:
    pauses_s = list(itertools.islice(make_pauses_s(FIRST_S, LONGEST_S), 12))
    assert pauses_s[0] == FIRST_S and pauses_s[-1] == LONGEST_S
    assert all(later == min(2 * sooner, LONGEST_S) for sooner, later in itertools.pairwise(pauses_s))


def test_pauses_grow_until_something_is_heard(benches) -> None:
    taken: list[list[float]] = []

    def record():
        taken.append([])
        for pause_s in make_pauses_s(FIRST_S, LONGEST_S):
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
    eventually(lambda: bench.opened == 10)
    growing = list(itertools.islice(make_pauses_s(FIRST_S, LONGEST_S), 8))
    assert [pauses_s for pauses_s in taken if pauses_s] == [growing, [FIRST_S]]


def test_what_the_tick_comes_too_late_for_is_counted_and_is_a_fault(benches) -> None:
    adapter = Adapter()
    bench = benches(adapter, room=10)
    for t_ns in range(15):
        adapter.coming.put(HELLO._replace(t_ns=t_ns))
    eventually(lambda: bench.tally["frames lost to overrun"] == 5)
    assert bench.bus.faults() == [CAN_OVERRUN(bus="CAN test 0", frames=5)]
    assert [frame.t_ns for frame in bench.bus.read()] == list(range(10)) and bench.bus.faults() == []
    assert ROOM >= 2000                                    # a second and more of a busy bus


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
    bus = SupervisedBus(lambda: open_can("slcan", str(plug), 1_000_000, clock, WAIT_S, tally), clock, tally)
    for said in (b"\x01", b"\x02"):
        eventually(lambda plugged=adapter: plugged.read() is not None and plugged.is_open)
        adapter.write(Frame(0, 0x21, said))
        assert [frame.data for frame in gather(bus, 1)] == [said] and bus.faults() == []
        plug.unlink()                 # first: a test beside this one may be given the terminal next
        adapter.close()
        eventually(lambda: why_lost(bus))
        assert str(plug) in why_lost(bus)
        adapter = SlcanAdapter(PtyCable(prompt=False))
        plug.symlink_to(adapter.port)
    assert tally["times lost"] == 2
    bus.close()
    adapter.close()
