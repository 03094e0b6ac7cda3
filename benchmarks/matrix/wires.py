"""What breaks between the robot and python-can, in its clocks, and nowhere else."""

import errno
import time
from types import TracebackType
from typing import Any

import can

from benchmarks.matrix.breaking import Breaking, Time
from benchmarks.matrix.span import Span
from truearc.hw.fault_codes import CAN_ADAPTER_ERROR
from truearc.hw.protocols import Clock, LinkLost
from truearc.hw.real.can_bus import CanBus

HOUR_S = 3600.0


class FlakyBus:
    """A python-can bus whose transmit queue is full, or that is gone, while the span stands."""

    def __init__(self, bus: Any, what: str, span: Span) -> None:
        self._bus, self._what, self._span = bus, what, span

    @staticmethod
    def over(bus: CanBus, what: str, span: Span) -> CanBus:
        """`bus`, with a flaky one underneath where one is wanted."""
        if what in ("queue full", "adapter out"):
            bus._bus = FlakyBus(bus._bus, what, span)
        return bus

    @staticmethod
    def check(what: str, span: Span) -> None:
        if what == "adapter out" and span.stands():
            raise LinkLost(CAN_ADAPTER_ERROR(bus="CAN", detail="no such device"))

    def recv(self, wait_s: float) -> can.Message | None:
        self._look()
        return self._bus.recv(wait_s)

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        self._look()
        if self._what == "queue full" and self._span.stands():
            raise can.CanOperationError("Transmit buffer full", errno.ENOBUFS)
        self._bus.send(message, timeout)

    def shutdown(self) -> None:
        self._bus.shutdown()

    def _look(self) -> None:
        if self._what == "adapter out" and self._span.stands():
            raise can.CanOperationError("no such device", errno.ENODEV)


class StallingClock:
    """A clock on which one sleep takes until the span is over: nothing else of the process stands still."""

    def __init__(self, clock: Clock, span: Span, stalls: bool) -> None:
        self._clock, self._span, self._stalls = clock, span, stalls

    def now_ns(self) -> int:
        return self._clock.now_ns()

    def sleep_until_ns(self, t_ns: int) -> None:
        self._clock.sleep_until_ns(t_ns)
        while self._stalls and self._span.stands():
            self._clock.sleep_until_ns(self._clock.now_ns() + 2_000_000)


class StandingWall:
    """The process reads another time of day while the span stands; the machine's own clock is left alone."""

    def __init__(self, breaking: Breaking, span: Span) -> None:
        jump_s = {"clock +1 h": HOUR_S, "clock -1 h": -HOUR_S}.get(getattr(breaking, "what", ""), 0.0)
        self._jump_s = jump_s if isinstance(breaking, Time) else 0.0
        self._span, self._time = span, time.time

    def __enter__(self) -> None:
        if self._jump_s:
            time.time = lambda: self._time() + (self._jump_s if self._span.stands() else 0.0)

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        time.time = self._time
