"""A CAN bus that outlives its adapter: read by a thread of its own, and opened again whenever it is lost.

python-can's Notifier would not do: an exception in it ends its thread silently.
"""

import contextlib
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator
from functools import partial

from truearc.hw.fault_codes import CAN_ADAPTER_ERROR, CAN_CLOSED, CAN_OVERRUN, CAN_REOPENED, CAN_SILENT
from truearc.hw.protocols import Clock, Frame, LinkLost
from truearc.hw.real.can_bus import CanBus, NeverOpens
from truearc.hw.real.clock import make_pauses_s
from truearc.hw.reason import Reason

WAIT_S = 0.02                         # how often a thread that receives no frames looks up
SILENT_NS = 1_000_000_000             # a bus on which nothing is heard for so long is lost: not all adapters tell
ROOM = 4096                           # frames that may wait for the tick: two seconds of a busy bus
OVERRUN = "frames lost to overrun"
FIRST_S, LONGEST_S = 0.05, 2.0        # pauses between attempts to open it again


class SupervisedBus:
    """truearc.hw.protocols.Bus over whatever `open_bus` opens, again and again.

    One thread takes every frame in as it comes, stamped with that moment, so that its age is its own and not the
    tick's. When the bus is lost, or silent for a second (an adapter that went bus-off without saying so), it is closed
    and opened again, after pauses that grow; `read` and `write` raise LinkLost meanwhile, and from then until
    something is heard again there is a fault. `tally` counts.
    """

    def __init__(self, open_bus: Callable[[], CanBus], clock: Clock, tally: Counter[str], room: int = ROOM,
                 pauses: Callable[[], Iterator[float]] | None = None, name: str | None = None) -> None:
        """Opens the bus at once, so that one that cannot be is an error here: LinkLost.

        `room`: frames that may wait for the tick. `pauses`: of s between attempts to open it again, make_pauses_s.
        `name`: of a bus that may also come later, so that only NeverOpens is an error here; None: it may not.
        """
        self._open_bus, self._clock, self._tally = open_bus, clock, tally
        self._room, self._pauses = room, pauses or partial(make_pauses_s, FIRST_S, LONGEST_S)
        self._bus: CanBus | None = None
        self._lost: Reason | None = None          # why, until something is heard again
        try:
            self._bus = open_bus()
        except LinkLost as error:
            if name is None or isinstance(error, NeverOpens):
                raise
            self._lost = error.reason
        self.name = self._bus.name if self._bus is not None else str(name)
        self._lock = threading.Lock()             # of writing to the bus and of taking it away; the thread alone reads
        self._frames: deque[Frame] = deque()
        self._broken: Reason | None = None        # why a write found the bus lost
        self._told = 0                            # frames lost to overrun of which there has been a fault
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._supervise, name=self.name, daemon=True)
        self._thread.start()

    @property
    def lost(self) -> Reason | None:
        """Why there is no bus; None while there is one."""
        return self._lost if self._bus is None else None

    def read(self) -> list[Frame]:
        """All frames received since the last call, oldest first; LinkLost, saying why, while there is no bus."""
        if self._bus is None:
            raise self._loss()
        return [self._frames.popleft() for _ in range(len(self._frames))]

    def write(self, frame: Frame) -> bool:
        with self._lock:
            if self._bus is None:
                raise self._loss()
            try:
                return self._bus.write(frame)
            except LinkLost as error:
                self._broken = error.reason
                raise

    def faults(self) -> list[Reason]:
        before, self._told = self._told, self._tally[OVERRUN]
        late = self._told - before
        faults = [CAN_OVERRUN(bus=self.name, frames=late)] if late else []
        lost = self._lost
        if lost is not None and self._bus is not None:
            faults.append(CAN_REOPENED(bus=self.name, cause=lost))
        return faults

    def close(self) -> None:
        self._stop.set()
        self._thread.join(timeout=1.0)
        self._take_away(CAN_CLOSED(bus=self.name))

    def _supervise(self) -> None:
        pauses_s = self._pauses()
        while not self._stop.is_set():
            if self._bus is None:
                if not self._stop.wait(next(pauses_s)):
                    self._open_again()
            elif why := self._listen(self._bus):
                if self._lost is None:            # it had been heard: this is a new trouble
                    pauses_s = self._pauses()
                self._tally["times lost"] += 1
                self._take_away(why)

    def _open_again(self) -> None:
        try:
            bus = self._open_bus()
        except Exception as error:    # as in _listen
            self._lost = self._reason_of(error)
            return
        self._broken = None
        self._bus = bus

    def _listen(self, bus: CanBus) -> Reason | None:
        """Take frames in until the bus is lost; returns why."""
        heard_ns = self._clock.now_ns()
        try:
            while not self._stop.is_set() and not self._broken:
                frame = bus.receive(WAIT_S)
                if frame is not None:
                    heard_ns = frame.t_ns
                    self._keep(frame)
                elif self._clock.now_ns() - heard_ns >= SILENT_NS:
                    return CAN_SILENT(bus=self.name, silence_s=SILENT_NS * 1e-9)
        except Exception as error:    # whatever a driver may raise: a reader that dies in silence is what must not be
            return self._reason_of(error)
        return self._broken

    def _reason_of(self, error: Exception) -> Reason:
        if isinstance(error, LinkLost):
            return error.reason
        return CAN_ADAPTER_ERROR(bus=self.name, detail=f"{type(error).__name__}: {error}")

    def _loss(self) -> LinkLost:
        return LinkLost(self._lost or CAN_CLOSED(bus=self.name))      # meanwhile it may have been opened again

    def _keep(self, frame: Frame) -> None:
        self._lost = None
        if len(self._frames) >= self._room:       # the newest is lost, as in a controller: only the tick takes out
            self._tally[OVERRUN] += 1
        else:
            self._frames.append(frame)

    def _take_away(self, why: Reason) -> None:
        with self._lock:
            self._lost = why
            bus, self._bus = self._bus, None
        if bus is not None:
            with contextlib.suppress(Exception):  # it is gone, whatever its driver says of that
                bus.close()
