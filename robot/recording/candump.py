"""Raw CAN as candump text: `(seconds.microseconds) can0 ID#DATA R|T`; opens in can-utils, SavvyCAN and python-can."""

from collections.abc import Callable

from hw.link import Bus, Frame


def candump_line(frame: Frame, sent: bool, t_ns: int, channel: str = "can0") -> str:
    """One line of text; the time is the tick's, on the rig's monotonic clock."""
    name = f"{frame.arbitration_id:08X}" if frame.is_extended else f"{frame.arbitration_id:03X}"
    data = f"R{len(frame.data) or ''}" if frame.is_remote else frame.data.hex().upper()
    return f"({t_ns // 1_000_000_000}.{t_ns // 1000 % 1_000_000:06d}) {channel} {name}#{data} {'T' if sent else 'R'}\n"


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

    def faults(self) -> list[str]:
        return self._bus.faults()

    def close(self) -> None:
        self._bus.close()
