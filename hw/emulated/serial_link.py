"""The device end of an emulated serial cable, and an emulated slcan adapter that carries CAN frames over it."""

import contextlib
import os
import re
import select
import socket
import struct
from typing import Protocol

from truearc.hw.protocols import Frame
from truearc.hw.reason import Reason

with contextlib.suppress(ImportError):        # Windows has none of them
    import fcntl
    import termios
    import tty

CHUNK = 65536
FULL = 65536                                      # unread bytes: the rest is lost


class Cable(Protocol):
    """The device's end of a cable. `port` is what the robot opens with pyserial."""

    port: str

    def write(self, data: bytes) -> bool:
        """Send `data`; return False if it is lost because nothing reads it. Does not block for long."""

    def read(self) -> bytes:
        """Return the bytes that the robot has sent since the last call. Does not block."""

    def close(self) -> None: ...


class SocketCable:
    """A listener on the loopback interface, for one reader at a time."""

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


WAIT_S = 0.0005                                   # between looks at whether the bytes have arrived
LOOKS = 2000
UNREAD = 2048                                     # bytes; the kernel holds twice that, and then waits


class PtyCable:
    """A pseudo-terminal. Its reading end is kept open too, so that the line stays raw and a late reader misses nothing.

    `prompt`: written data can be read when `write` returns, for a reader in the same thread whose next tick must always
    see it. Otherwise the kernel carries it across in its own time.
    """

    def __init__(self, prompt: bool = True) -> None:
        self._far, self._near = os.openpty()
        tty.setraw(self._near)
        os.set_blocking(self._far, False)
        self._prompt, self._rest = prompt, b""
        self.port = os.ttyname(self._near)

    def write(self, data: bytes) -> bool:
        waiting = self._waiting() if self._prompt else 0
        if waiting > UNREAD or len(self._rest) > FULL:
            return False                                    # unread for a long time: the line is lost
        self._rest += data
        sent = 0
        with contextlib.suppress(BlockingIOError):
            sent = os.write(self._far, self._rest)
        self._rest = self._rest[sent:]
        if self._prompt:
            self._wait_for(waiting + sent)
        return True

    def read(self) -> bytes:
        with contextlib.suppress(BlockingIOError):
            return os.read(self._far, FULL)
        return b""

    def close(self) -> None:
        os.close(self._far)
        os.close(self._near)

    def _wait_for(self, waiting: int) -> None:
        for _ in range(LOOKS):
            if self._waiting() >= waiting:
                return
            select.select([], [], [], WAIT_S)

    def _waiting(self) -> int:
        return int(struct.unpack("i", fcntl.ioctl(self._near, termios.FIONREAD, b"\0\0\0\0"))[0])


def open_cable(prompt: bool) -> Cable:
    """Open a pseudo-terminal, or a loopback socket if the system has none; `prompt` as in PtyCable."""
    with contextlib.suppress(AttributeError, NameError, OSError):       # Windows has neither openpty nor tty
        return PtyCable(prompt)
    return SocketCable()


# --- a CAN adapter

CR, BEL = b"\r", b"\a"
VERSION, SERIAL = b"V1013\r", b"NT254\r"
BITRATES = (10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 800_000, 1_000_000)
LONGEST = 32                                      # characters; no command is longer

_FRAME = re.compile(rb"(?:([tr])([0-7][0-9A-F]{2})|([TR])([01][0-9A-F]{7}))([0-8])((?:[0-9A-F]{2})*)", re.IGNORECASE)


class SlcanAdapter:
    """truearc.hw.protocols.Bus as the emulated devices see it, through an adapter to a host that opens `port`.

    Until the host opens the channel, nothing passes in either direction.
    """

    def __init__(self, cable: Cable) -> None:
        self.port = cable.port
        self.bitrate: int | None = None
        self.is_open = self.is_listening = False
        self._cable = cable
        self._pending = b""

    def read(self) -> list[Frame]:
        """Return the frames that the host has sent since the last call; its other commands are executed on the way."""
        *lines, self._pending = (self._pending + self._cable.read()).split(CR)
        frames: list[Frame] = []
        for line in lines:
            answer, frame = self._obey(line)
            if frame is not None:
                frames.append(frame)
            self._cable.write(answer)
        if len(self._pending) > LONGEST:
            self._pending = b""
            self._cable.write(BEL)
        return frames

    def write(self, frame: Frame) -> bool:
        """Pass on a device's frame; return False if the host does not fetch what it is sent."""
        return not self.is_open or self._cable.write(make_line(frame))

    def faults(self) -> list[Reason]:
        return []

    def close(self) -> None:
        self._cable.close()

    def _obey(self, line: bytes) -> tuple[bytes, Frame | None]:
        if line[:1] in (b"t", b"T", b"r", b"R"):
            frame = parse_line(line) if self.is_open and not self.is_listening else None
            return (BEL if frame is None else b"Z\r" if frame.is_extended else b"z\r"), frame
        return self._command(line), None

    def _command(self, line: bytes) -> bytes:
        if line == b"":
            return CR
        if line in (b"O", b"L") and not self.is_open:
            self.is_open, self.is_listening = True, line == b"L"
            return CR
        if line == b"C" and self.is_open:
            self.is_open = self.is_listening = False
            return CR
        if not self.is_open and re.fullmatch(rb"S[0-8]|s[0-9A-Fa-f]{4}", line):
            self.bitrate = BITRATES[int(line[1:])] if line[:1] == b"S" else None
            return CR
        answers = {b"V": VERSION, b"N": SERIAL} | ({b"F": b"F00\r"} if self.is_open else {})
        return answers.get(line, BEL)


def make_line(frame: Frame) -> bytes:
    """Return the line that passes a received frame to the host."""
    kind = ("R" if frame.is_extended else "r") if frame.is_remote else ("T" if frame.is_extended else "t")
    name = f"{frame.arbitration_id:08X}" if frame.is_extended else f"{frame.arbitration_id:03X}"
    return f"{kind}{name}{len(frame.data)}{frame.data.hex().upper()}\r".encode("ascii")


def parse_line(line: bytes) -> Frame | None:
    """Return the frame that a line without its end asks to send; None if it does not match exactly."""
    match = _FRAME.fullmatch(line)
    if match is None:
        return None
    kind, data = match[1] or match[3], bytes.fromhex(match[6].decode("ascii"))
    is_remote = kind in (b"r", b"R")
    if len(data) != (0 if is_remote else int(match[5])):
        return None
    return Frame(0, int(match[2] or match[4], 16), data, match[3] is not None, is_remote)
