"""What goes wrong with a device on the bus, between two times: given as data, without chance."""

from msgspec import Struct

from hw.emulated.nodes import Node
from hw.link import Frame

SILENT = "silent"                                 # it hears, but nothing of it reaches the bus
UNPLUGGED = "unplugged"                           # neither
UNPOWERED = "unpowered"                           # nor does it drive; when it ends the device starts anew
TRUNCATED = "truncated"                           # its frames keep their first `length` bytes
OVERWRITTEN = "overwritten"                       # its frames say `data` from byte `at` on
KINDS = (SILENT, UNPLUGGED, UNPOWERED, TRUNCATED, OVERWRITTEN)


class Fault(Struct, frozen=True):
    """One thing wrong from `begin_ns` until `end_ns` (not included); with `frame_id`, only with those frames."""

    kind: str
    begin_ns: int
    end_ns: int
    frame_id: int | None = None
    length: int = 0
    at: int = 0
    data: bytes = b""

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"no fault {self.kind!r}; there are {', '.join(KINDS)}")


class FaultyNode:
    """A node with things wrong with it.

    What drives its motor is unaffected, unless it no longer hears commands or has no power.
    """

    def __init__(self, node: Node, faults: tuple[Fault, ...]) -> None:
        self.motor = node.motor
        self._node, self._faults = node, faults
        self._cuts = sorted((fault.begin_ns, fault.end_ns) for fault in faults if fault.kind == UNPOWERED)
        self._dark_until_ns: int | None = None

    def ids(self) -> tuple[tuple[int, bool], ...]:
        return self._node.ids()

    def receive(self, frame: Frame, t_ns: int) -> list[Frame]:
        if not self._has_power(t_ns) or any(fault.kind == UNPLUGGED for fault in self._standing(t_ns)):
            return []
        return self._spoil(self._node.receive(frame, t_ns), t_ns)

    def due_ns(self) -> int:
        if self._dark_until_ns is not None:
            return self._dark_until_ns
        return min([self._node.due_ns(), *(begin_ns for begin_ns, _ in self._cuts[:1])])

    def step(self, t_ns: int) -> list[Frame]:
        return self._spoil(self._node.step(t_ns), t_ns) if self._has_power(t_ns) else []

    def torque_nm(self) -> float:
        return 0.0 if self._dark_until_ns is not None else self._node.torque_nm()

    def restart(self, t_ns: int) -> None:
        self._node.restart(t_ns)

    def _has_power(self, t_ns: int) -> bool:
        if self._dark_until_ns is not None and t_ns >= self._dark_until_ns:
            self._dark_until_ns = None
            self._node.restart(t_ns)
        if self._cuts and t_ns >= self._cuts[0][0]:
            self._dark_until_ns = self._cuts.pop(0)[1]
        return self._dark_until_ns is None

    def _standing(self, t_ns: int) -> list[Fault]:
        return [fault for fault in self._faults if fault.begin_ns <= t_ns < fault.end_ns]

    def _spoil(self, frames: list[Frame], t_ns: int) -> list[Frame]:
        for fault in self._standing(t_ns):
            frames = [spoiled for frame in frames for spoiled in _spoil(frame, fault)]
        return frames


def _spoil(frame: Frame, fault: Fault) -> list[Frame]:
    if fault.frame_id is not None and fault.frame_id != frame.arbitration_id:
        return [frame]
    if fault.kind in (SILENT, UNPLUGGED):
        return []
    if fault.kind == TRUNCATED:
        return [frame._replace(data=frame.data[:fault.length])]
    data = frame.data[:fault.at] + fault.data + frame.data[fault.at + len(fault.data):]
    return [frame._replace(data=data[:len(frame.data)])]
