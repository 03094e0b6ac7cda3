"""The cable of a serial device: a pseudo-terminal, or a loopback socket where there are none."""

import contextlib
import socket
from typing import Protocol

CHUNK = 65536
FULL = 65536                                      # unread bytes: the rest is lost


class Cable(Protocol):
    """The device's end of a cable. `port` is what the robot opens with pyserial."""

    port: str

    def write(self, data: bytes) -> bool:
        """Send `data`; False when it is lost for want of a reader. Does not block for long."""

    def read(self) -> bytes:
        """Return the bytes that the robot has sent since the last call. Does not block."""

    def close(self) -> None: ...


class SocketCable:
    """A listener on the loopback interface, for one reader after the other."""

    def __init__(self) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.setblocking(False)
        self._reader: socket.socket | None = None
        self._rest = b""
        self.port = f"socket://127.0.0.1:{self._listener.getsockname()[1]}"

    def write(self, data: bytes) -> bool:
        reader = self._find_reader()
        if reader is None or len(self._rest) > FULL:
            return False
        self._rest += data
        try:
            self._rest = self._rest[reader.send(self._rest):]
        except BlockingIOError:
            return True
        except OSError:
            self._hang_up()
            return False
        return True

    def read(self) -> bytes:
        reader = self._find_reader()
        if reader is None:
            return b""
        try:
            data = reader.recv(CHUNK)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._hang_up()
        return data

    def close(self) -> None:
        self._hang_up()
        self._listener.close()

    def _find_reader(self) -> socket.socket | None:
        if self._reader is None:
            with contextlib.suppress(BlockingIOError):
                self._reader, _ = self._listener.accept()
                self._reader.setblocking(False)
                self._reader.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return self._reader

    def _hang_up(self) -> None:
        if self._reader is not None:
            self._reader.close()
        self._reader, self._rest = None, b""


def open_cable(prompt: bool) -> Cable:
    """A pseudo-terminal, or a loopback socket where the system has none to give; `prompt` as PtyCable has it."""
    try:
        from truearc.hw.emulated.pty_cable import PtyCable
        return PtyCable(prompt)
    except (ImportError, OSError):                # ImportError: Windows
        return SocketCable()
