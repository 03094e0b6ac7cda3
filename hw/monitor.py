"""Monitor of the bus: unknown frames, a second host, two devices with one id."""

from collections import Counter, deque
from collections.abc import Iterable, Mapping

from truearc.hw.fault_codes import DUPLICATE_ID, FOREIGN_HOST
from truearc.hw.protocols import Bus, Clock, Frame
from truearc.hw.reason import Reason

Kind = tuple[int, bool, bool]         # arbitration id, is extended, is remote
NS_PER_S = 1_000_000_000
WINDOW_NS = NS_PER_S                  # pulses are counted over this long; what was wrong is said for as long
SHARE = 1.5                           # times as many pulses as one device gives: two give twice as many
KINDS = 100                           # unknown kinds counted one by one; noise could have millions


def kind_of(frame: Frame) -> Kind:
    return frame.arbitration_id, frame.is_extended, frame.is_remote


class MonitoredBus:
    """A bus whose incoming frames are counted in `tally` and judged, and passed on as they are.

    `known`: what our devices send. `ours`: what only we may send; we do not hear ourselves, so one of these coming in
    is another host at work. `pulses`: kind -> its period (ns), of one frame of each device whose period is known, at
    which two devices with the same id would give themselves away.
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
                *(FOREIGN_HOST(frame=name) for name, heard_ns in self._foreign.items() if t_ns - heard_ns < WINDOW_NS),
                *(fault for pulse in self._pulses.values() if (fault := pulse.fault(t_ns)) is not None)]

    def _count_unknown(self, name: str) -> None:
        if len(self._unknown) < KINDS:
            self._unknown.add(name)
        self._tally[f"unknown frames {name if name in self._unknown else 'of other kinds'}"] += 1


class _Pulse:
    """One kind of frame that one device sends every `period_ns`, as heard of late."""

    def __init__(self, period_ns: int) -> None:
        self._usual = WINDOW_NS // period_ns
        self._most = int(SHARE * self._usual) + 1
        self._heard_ns: deque[int] = deque(maxlen=self._most + 1)
        self._name = ""

    def take(self, frame: Frame) -> None:
        self._heard_ns.append(frame.t_ns)
        self._name = frame.name

    def fault(self, t_ns: int) -> Reason | None:
        """None while there is one device at most."""
        while self._heard_ns and t_ns - self._heard_ns[0] >= WINDOW_NS:
            self._heard_ns.popleft()
        if len(self._heard_ns) <= self._most:
            return None
        return DUPLICATE_ID(frame=self._name, most=self._most, window_s=WINDOW_NS * 1e-9, usual=self._usual)
