"""The button box at the far end of its cable: a pseudo-terminal, or a loopback socket where there are none."""

import contextlib
import socket
from typing import Protocol

from hw import buttons


class Cable(Protocol):
    """What a box hangs on. `port` is what the robot opens with pyserial."""

    port: str

    def write(self, data: bytes) -> None:
        """Say `data`; returns once the other end can read it. Lost when nobody listens."""

    def close(self) -> None: ...


class SocketCable:
    """A listener on the loopback interface, for one reader."""

    def __init__(self) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.setblocking(False)
        self._reader: socket.socket | None = None
        self.port = f"socket://127.0.0.1:{self._listener.getsockname()[1]}"

    def write(self, data: bytes) -> None:
        if self._reader is None:
            with contextlib.suppress(BlockingIOError):
                self._reader, _ = self._listener.accept()
                self._reader.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if self._reader is not None:
            with contextlib.suppress(BlockingIOError, BrokenPipeError, ConnectionResetError):
                self._reader.send(data)

    def close(self) -> None:
        if self._reader is not None:
            self._reader.close()
        self._listener.close()


class ButtonBox:
    """The box: counts presses, and says every half second that it is there."""

    def __init__(self, cable: Cable, start_ns: int = 0) -> None:
        self.port = cable.port
        self._cable: Cable | None = cable
        self._seq = 0
        self._due_ns = start_ns

    def press(self, button: str) -> None:
        """One press of a button, at once; ValueError for an unknown one. Nothing is said once unplugged."""
        self._seq = (self._seq + 1) % buttons.SEQ_COUNT
        self._say(buttons.make_press(self._seq, button))

    def step(self, t_ns: int) -> None:
        """Say the heartbeat that is due by `t_ns`; those missed meanwhile are skipped."""
        if t_ns >= self._due_ns:
            self._due_ns += buttons.HEARTBEAT_NS * (1 + (t_ns - self._due_ns) // buttons.HEARTBEAT_NS)
            self._say(buttons.make_heartbeat(self._seq))

    def unplug(self) -> None:
        """Pull the cable out, for good; the robot's next read says so."""
        if self._cable is not None:
            self._cable.close()
            self._cable = None

    def _say(self, line: bytes) -> None:
        if self._cable is not None:
            self._cable.write(line)


def open_button_box(start_ns: int = 0) -> ButtonBox:
    """A box on a pseudo-terminal, or on a loopback socket where the system has none to give."""
    try:
        from hw.emulated.pty_cable import PtyCable
        return ButtonBox(PtyCable(), start_ns)
    except (ImportError, OSError):                # ImportError: Windows
        return ButtonBox(SocketCable(), start_ns)
