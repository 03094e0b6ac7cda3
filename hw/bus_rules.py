"""The rules of a CAN bus: the frames that may be sent, their rates, and the senders of received frames.

`AllowedBus` refuses every frame that is not on the allow list. It does not depend on the sender, so a faulty controller
cannot bypass it. `MonitoredBus` counts unknown frames, and reports a second host or two devices with the same id. A
`Rules` object is one device's contribution to both.
"""

from collections import Counter, deque
from collections.abc import Iterable, Mapping

from msgspec import Struct

from truearc.hw.fault_codes import DUPLICATE_ID, FOREIGN_HOST, FRAME_NOT_ALLOWED, FRAME_RATE_EXCEEDED
from truearc.hw.protocols import NS_PER_S, Bus, Clock, Frame
from truearc.hw.reason import Reason

# --- the allow list

WINDOW_NS = 100_000_000               # rates are counted over this long


class Allowed(Struct, frozen=True):
    """One kind of frame: exactly this id and length, at most `most` of them within any WINDOW_NS."""

    arbitration_id: int
    is_extended: bool
    is_remote: bool
    length: int                       # bytes of data
    most: int


def allow(example: Frame, most: int) -> Allowed:
    """Return a rule that allows frames like this one, whatever their data."""
    return Allowed(example.arbitration_id, example.is_extended, example.is_remote, len(example.data), most)


class AllowList:
    """The kinds of frames that may be sent, and when each was recently sent."""

    def __init__(self, allowed: Iterable[Allowed]) -> None:
        self._kinds = {(kind.arbitration_id, kind.is_extended, kind.is_remote, kind.length): (kind.most, deque[int]())
                       for kind in allowed}

    def refuse(self, frame: Frame, t_ns: int) -> Reason | None:
        """Return why `frame` may not be sent at `t_ns`; None if it may, in which case it counts as sent."""
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
    """A bus that sends only allowed frames; `tally` counts the refused ones."""

    def __init__(self, bus: Bus, allowed: Iterable[Allowed], clock: Clock, tally: Counter[str]) -> None:
        self._bus, self._clock, self._tally = bus, clock, tally
        self._list = AllowList(allowed)
        self._refused: list[Reason] = []

    def read(self) -> list[Frame]:
        return self._bus.read()

    def write(self, frame: Frame) -> bool:
        """Write as the bus does; return False and report a fault for a frame that may not be sent."""
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


# --- the monitor

Kind = tuple[int, bool, bool]         # arbitration id, is extended, is remote
PULSE_WINDOW_NS = NS_PER_S                  # pulses are counted over this long; what was wrong is said for as long
SHARE = 1.5                           # times as many pulses as one device gives: two give twice as many
KINDS = 100                           # unknown kinds counted one by one; noise could have millions


def kind_of(frame: Frame) -> Kind:
    return frame.arbitration_id, frame.is_extended, frame.is_remote


class MonitoredBus:
    """A bus whose incoming frames are counted in `tally`, checked, and passed on unchanged.

    `known`: frames that our devices send. `ours`: frames that only we may send; since we do not receive our own,
    receiving one reveals another host. `pulses`: kind -> period (ns) of one frame of each device with a known period,
    which reveals two devices with the same id.
    """

    def __init__(self, bus: Bus, known: Iterable[Kind], ours: Iterable[Kind], pulses: Mapping[Kind, int],
                 clock: Clock, tally: Counter[str]) -> None:
        self._bus, self._clock, self._tally = bus, clock, tally
        self._known, self._ours = frozenset(known), frozenset(ours)
        self._pulses = {kind: _Pulse(period_ns) for kind, period_ns in pulses.items()}
        self._unknown: set[str] = set()
        self._foreign: dict[str, int] = {}        # frame of ours -> when another host last sent it

    def read(self) -> list[Frame]:
        frames = self._bus.read()
        for frame in frames:
            kind = kind_of(frame)
            if kind in self._pulses:
                self._pulses[kind].take(frame)
            elif kind in self._ours:
                self._tally["frames of another host"] += 1
                self._foreign[frame.name] = frame.t_ns
            elif kind not in self._known:
                self._count_unknown(frame.name)
        return frames

    def write(self, frame: Frame) -> bool:
        return self._bus.write(frame)

    def faults(self) -> list[Reason]:
        t_ns = self._clock.now_ns()
        return [*self._bus.faults(),
                *(FOREIGN_HOST(frame=name) for name, heard_ns in self._foreign.items()
                  if t_ns - heard_ns < PULSE_WINDOW_NS),
                *(fault for pulse in self._pulses.values() if (fault := pulse.fault(t_ns)) is not None)]

    def _count_unknown(self, name: str) -> None:
        if len(self._unknown) < KINDS:
            self._unknown.add(name)
        self._tally[f"unknown frames {name if name in self._unknown else 'of other kinds'}"] += 1


class _Pulse:
    """One kind of frame that one device sends every `period_ns`, as heard of late."""

    def __init__(self, period_ns: int) -> None:
        self._usual = PULSE_WINDOW_NS // period_ns
        self._most = int(SHARE * self._usual) + 1
        self._heard_ns: deque[int] = deque(maxlen=self._most + 1)
        self._name = ""

    def take(self, frame: Frame) -> None:
        self._heard_ns.append(frame.t_ns)
        self._name = frame.name

    def fault(self, t_ns: int) -> Reason | None:
        """None while there is one device at most."""
        while self._heard_ns and t_ns - self._heard_ns[0] >= PULSE_WINDOW_NS:
            self._heard_ns.popleft()
        if len(self._heard_ns) <= self._most:
            return None
        return DUPLICATE_ID(frame=self._name, most=self._most, window_s=PULSE_WINDOW_NS * 1e-9, usual=self._usual)


# --- the rules of one device

SELDOM = 5                            # within WINDOW_NS, of what is asked a few times a second at most


class Rules(Struct, frozen=True):
    """Rules of one device: the frames that it may be sent, those that hosts and the device send, and one kind with its
    period."""

    allowed: tuple[Allowed, ...]      # nothing: the device is another controller's
    by_host: tuple[Kind, ...]
    by_device: tuple[Kind, ...]
    pulse: dict[Kind, int]            # kind -> period in ns


def allow_seldom(frames: Iterable[Frame]) -> tuple[Allowed, ...]:
    """Return rules that allow frames like these a few times a second."""
    return tuple(allow(frame, SELDOM) for frame in frames)


def kinds_of(frame_ids: Iterable[int], is_extended: bool) -> tuple[Kind, ...]:
    """Return the kinds of data frames with these arbitration ids."""
    return tuple((frame_id, is_extended, False) for frame_id in frame_ids)
