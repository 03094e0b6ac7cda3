"""Raw CAN as candump text: `(seconds.microseconds) can0 ID#DATA R|T`; opens in can-utils, SavvyCAN and python-can."""

import re
from collections.abc import Callable

from truearc.hw.protocols import Bus, Frame
from truearc.hw.reason import Reason

_LINE = re.compile(r"\((\d+)\.(\d{6})\) [!-~]+ ([0-9A-F]{3}|[0-9A-F]{8})#(R[1-8]?|(?:[0-9A-F]{2}){0,64}) ([RT])\n")


def candump_line(frame: Frame, sent: bool, t_ns: int) -> str:
    """One line of text, times on the rig's monotonic clock: when it was received, or the tick `t_ns` that sent it."""
    t_ns = t_ns if sent else frame.t_ns
    name = f"{frame.arbitration_id:08X}" if frame.is_extended else f"{frame.arbitration_id:03X}"
    data = f"R{len(frame.data) or ''}" if frame.is_remote else frame.data.hex().upper()
    return f"({t_ns // 1_000_000_000}.{t_ns // 1000 % 1_000_000:06d}) can0 {name}#{data} {'T' if sent else 'R'}\n"


def parse_candump(line: str) -> tuple[Frame, bool] | None:
    """The frame that `candump_line` wrote, and whether it was sent; None for any other line, a torn one included."""
    match = _LINE.fullmatch(line)
    if match is None:
        return None
    seconds, micros, name, data, way = match.groups()
    remote = data.startswith("R")                 # a question has the length of its answer
    content = bytes(int(data[1:] or 0)) if remote else bytes.fromhex(data)
    frame = Frame(int(seconds) * 1_000_000_000 + int(micros) * 1000, int(name, 16), content, len(name) == 8, remote)
    return (frame._replace(t_ns=0) if way == "T" else frame), way == "T"


class TappedBus:
    """A bus that shows every frame to `tap(frame, sent)` on its way."""

    def __init__(self, bus: Bus, tap: Callable[[Frame, bool], None]) -> None:
        self._bus, self._tap = bus, tap

    def read(self) -> list[Frame]:
        frames = self._bus.read()
        for frame in frames:
            self._tap(frame, False)
        return frames

    def write(self, frame: Frame) -> bool:
        taken = self._bus.write(frame)
        if taken:
            self._tap(frame, True)
        return taken

    def faults(self) -> list[Reason]:
        return self._bus.faults()
