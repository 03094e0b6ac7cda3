"""Faults of a device on the bus between two times, given as data without randomness."""

from msgspec import Struct

from truearc.hw.emulated.nodes import Node
from truearc.hw.protocols import Frame

SILENT = "silent"                                 # it hears, but nothing of it reaches the bus
UNPLUGGED = "unplugged"                           # neither
UNPOWERED = "unpowered"                           # nor does it drive; when it ends the device restarts
DEAF = "deaf"                                     # it sends, but receives no frames
TRUNCATED = "truncated"                           # its frames keep their first `length` bytes
LENGTHENED = "lengthened"                         # its frames have `length` bytes, zeros after their own
OVERWRITTEN = "overwritten"                       # its frames say `data` from byte `at` on
STUCK = "stuck"                                   # each of its frames says what the first of its kind said
DOUBLED = "doubled"                               # each of its frames comes twice
HELD = "held"                                     # its frames are held back, and come all at once at the end
MOVED = "moved"                                   # its frames have an id that is higher by `by`
KINDS = (SILENT, UNPLUGGED, UNPOWERED, DEAF, TRUNCATED, LENGTHENED, OVERWRITTEN, STUCK, DOUBLED, HELD, MOVED)


class Fault(Struct, frozen=True):
    """One fault from `begin_ns` until `end_ns` (exclusive); with `frame_id`, only for those frames."""

    kind: str
    begin_ns: int
    end_ns: int
    frame_id: int | None = None
    length: int = 0
    at: int = 0
    data: bytes = b""
    by: int = 0

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"no fault {self.kind!r}; there are {', '.join(KINDS)}")


class FaultyNode:
    """A node with faults.

    Its motor output is unaffected, unless it no longer receives commands or has no power.
    """

    def __init__(self, node: Node, faults: tuple[Fault, ...]) -> None:
        self.motor = node.motor
        self.node = node
        self._faults: tuple[Fault, ...] = ()
        self._cuts: list[tuple[int, int]] = []
        self._dark_until_ns: int | None = None
        self._first: dict[int, Frame] = {}        # of each kind, since it has been stuck
        self._held: list[Frame] = []
        self.suffer(*faults)

    def suffer(self, *faults: Fault) -> None:
        """Add these faults."""
        self._faults += faults
        self._cuts = sorted([*self._cuts, *((fault.begin_ns, fault.end_ns) for fault in faults
                                            if fault.kind == UNPOWERED)])

    def ids(self) -> tuple[tuple[int, bool], ...]:
        return self.node.ids()

    def receive(self, frame: Frame, t_ns: int) -> list[Frame]:
        if not self._has_power(t_ns) or any(fault.kind in (UNPLUGGED, DEAF) for fault in self._standing(t_ns)):
            return []
        return self._spoil(self.node.receive(frame, t_ns), t_ns)

    def due_ns(self) -> int:
        if self._dark_until_ns is not None:
            return self._dark_until_ns
        return min([self.node.due_ns(), *(begin_ns for begin_ns, _ in self._cuts[:1])])

    def step(self, t_ns: int) -> list[Frame]:
        return self._spoil(self.node.step(t_ns), t_ns) if self._has_power(t_ns) else []

    def torque_nm(self) -> float:
        return 0.0 if self._dark_until_ns is not None else self.node.torque_nm()

    def restart(self, t_ns: int) -> None:
        self.node.restart(t_ns)

    def _has_power(self, t_ns: int) -> bool:
        if self._dark_until_ns is not None and t_ns >= self._dark_until_ns:
            self._dark_until_ns = None
            self.node.restart(t_ns)
        if self._cuts and t_ns >= self._cuts[0][0]:
            self._dark_until_ns = self._cuts.pop(0)[1]
        return self._dark_until_ns is None

    def _standing(self, t_ns: int) -> list[Fault]:
        return [fault for fault in self._faults if fault.begin_ns <= t_ns < fault.end_ns]

    def _spoil(self, frames: list[Frame], t_ns: int) -> list[Frame]:
        standing = self._standing(t_ns)
        if not any(fault.kind == STUCK for fault in standing):
            self._first.clear()
        if self._held and not any(fault.kind == HELD for fault in standing):
            frames, self._held = [*self._held, *frames], []
        for fault in standing:
            frames = [spoiled for frame in frames for spoiled in self._spoil_one(frame, fault)]
        return frames

    def _spoil_one(self, frame: Frame, fault: Fault) -> list[Frame]:
        if fault.frame_id is not None and fault.frame_id != frame.arbitration_id:
            return [frame]
        if fault.kind == STUCK:
            return [self._first.setdefault(frame.arbitration_id, frame)]
        if fault.kind == HELD:
            self._held.append(frame)
            return []
        return _spoil(frame, fault)


def _spoil(frame: Frame, fault: Fault) -> list[Frame]:
    match fault.kind:
        case "silent" | "unplugged":
            return []
        case "doubled":
            return [frame, frame]
        case "truncated":
            return [frame._replace(data=frame.data[:fault.length])]
        case "lengthened":
            return [frame._replace(data=frame.data.ljust(fault.length, b"\0"))]
        case "moved":
            return [frame._replace(arbitration_id=frame.arbitration_id + fault.by)]
        case "overwritten":
            data = frame.data[:fault.at] + fault.data + frame.data[fault.at + len(fault.data):]
            return [frame._replace(data=data[:len(frame.data)])]
    return [frame]                                # what it hears, or has no power for, is not about its frames
