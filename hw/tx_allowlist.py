"""What may be sent on a bus, and how often. Anything else is refused, counted and said, and never sent.

This is built from the configuration and knows nothing of whoever sends: a controller gone wild cannot get past it.
"""

from collections import Counter, deque
from collections.abc import Iterable

from msgspec import Struct

from truearc.hw.fault_codes import FRAME_NOT_ALLOWED, FRAME_RATE_EXCEEDED
from truearc.hw.protocols import Bus, Clock, Frame
from truearc.hw.reason import Reason

WINDOW_NS = 100_000_000               # rates are counted over this long


class Allowed(Struct, frozen=True):
    """One kind of frame: exactly this id and length, at most `most` of them within any WINDOW_NS."""

    arbitration_id: int
    is_extended: bool
    is_remote: bool
    length: int                       # bytes of data
    most: int


def allow(example: Frame, most: int) -> Allowed:
    """Frames such as this one, whatever they say."""
    return Allowed(example.arbitration_id, example.is_extended, example.is_remote, len(example.data), most)


class AllowList:
    """The kinds of frames that may be sent, and when each was sent of late."""

    def __init__(self, allowed: Iterable[Allowed]) -> None:
        self._kinds = {(kind.arbitration_id, kind.is_extended, kind.is_remote, kind.length): (kind.most, deque[int]())
                       for kind in allowed}

    def refuse(self, frame: Frame, t_ns: int) -> Reason | None:
        """Why `frame` may not be sent at `t_ns`; None when it may, and then it counts as sent."""
        kind = self._kinds.get((frame.arbitration_id, frame.is_extended, frame.is_remote, len(frame.data)))
        if kind is None:
            return FRAME_NOT_ALLOWED(frame=frame.name, bytes=len(frame.data), remote=frame.is_remote)
        most, sent_ns = kind
        while sent_ns and t_ns - sent_ns[0] >= WINDOW_NS:
            sent_ns.popleft()
        if len(sent_ns) >= most:
            return FRAME_RATE_EXCEEDED(frame=frame.name, most=most, window_s=WINDOW_NS * 1e-9)
        sent_ns.append(t_ns)
        return None


class AllowedBus:
    """A bus that sends only what is allowed; `tally` counts what was refused."""

    def __init__(self, bus: Bus, allowed: Iterable[Allowed], clock: Clock, tally: Counter[str]) -> None:
        self._bus, self._clock, self._tally = bus, clock, tally
        self._list = AllowList(allowed)
        self._refused: list[Reason] = []

    def read(self) -> list[Frame]:
        return self._bus.read()

    def write(self, frame: Frame) -> bool:
        """As the bus itself; False, and a fault, for a frame that may not be sent."""
        why = self._list.refuse(frame, self._clock.now_ns())
        if why is not None:
            self._tally["frames not allowed"] += 1
            if why not in self._refused:
                self._refused.append(why)
            return False
        return self._bus.write(frame)

    def faults(self) -> list[Reason]:
        refused, self._refused = self._refused, []
        return [*self._bus.faults(), *refused]
