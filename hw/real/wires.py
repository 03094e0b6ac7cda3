"""The serial port, and wires that a thread of their own opens again when they were lost."""

import contextlib
import threading
from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

import numpy as np
import numpy.typing as npt
import serial

from truearc.hw.fault_codes import SERIAL_ERROR
from truearc.hw.protocols import Camera, CameraFrame, LinkLost, Stream
from truearc.hw.reason import Reason

CHUNK = 4096                                      # bytes; more than a box says in a second


class SerialStream:
    """truearc.hw.protocols.Stream over an open port, which it owns. Neither call blocks."""

    def __init__(self, port: serial.SerialBase, name: str) -> None:
        self.name = name
        self._port = port

    def read(self) -> bytes:
        """All bytes received since the last call; LinkLost when the device is unplugged."""
        parts: list[bytes] = []
        try:
            while part := self._port.read(CHUNK):
                parts.append(part)
        except (serial.SerialException, OSError) as error:
            # Bytes from before the plug was pulled stay unread: half a line is useless, and the next call fails too.
            raise LinkLost(SERIAL_ERROR(port=self.name, detail=str(error))) from error
        return b"".join(parts)

    def close(self) -> None:
        with contextlib.suppress(serial.SerialException, OSError):      # an unplugged port may refuse even this
            self._port.close()


def open_serial(port: str, baud: int) -> SerialStream:
    """Open a port, for us alone where the system can promise that; LinkLost names the port when it cannot be."""
    try:
        stream = serial.serial_for_url(port, baudrate=baud, timeout=0, write_timeout=0, do_not_open=True)
        if "://" not in port:
            stream.exclusive = True
        stream.open()
    except (serial.SerialException, OSError, ValueError) as error:
        raise LinkLost(SERIAL_ERROR(port=port, detail=str(error))) from error
    return SerialStream(stream, port)


PAUSE_S = 0.5                                     # between tries; an open camera takes about as long
LONGEST_S = 4.0                                   # before one that can be opened, but stays silent, is opened again


class Closable(Protocol):
    def close(self) -> None: ...


Wire = TypeVar("Wire", bound=Closable)
Answer = TypeVar("Answer")
Image = npt.NDArray[np.uint8]


class Mended(Generic[Wire]):
    """A wire opened by `open_wire`, and again whenever it is lost or was not there to begin with; that raises LinkLost
    while it cannot be opened.

    One that is lost before it has answered anything is opened again after pauses that grow: opening does not fix it.
    """

    def __init__(self, open_wire: Callable[[], Wire], pause_s: float = PAUSE_S) -> None:
        self._wire: Wire | None = None
        self._open_wire, self._first_s, self._pause_s = open_wire, pause_s, pause_s
        self._why: Reason | None = None
        self._stop = threading.Event()
        self._mender: threading.Thread | None = None
        try:
            self._wire = open_wire()
        except LinkLost as error:
            self._why = error.reason
            self._start(None)

    @property
    def lost(self) -> Reason | None:
        """Why it is not open; None while it is."""
        return self._why if self._wire is None else None

    def ask(self, question: Callable[[Wire], Answer]) -> Answer:
        """What `question` makes of the wire; LinkLost, every time, from when it is lost until it is open again."""
        wire = self._wire
        if wire is None:
            assert self._why is not None
            raise LinkLost(self._why)
        try:
            answer = question(wire)
        except LinkLost as error:
            self._why, self._wire = error.reason, None
            self._start(wire)
            raise
        if answer is not None:
            self._pause_s = self._first_s
        return answer

    def close(self) -> None:
        self._stop.set()
        if self._mender is not None:
            self._mender.join()
        if self._wire is not None:
            self._wire.close()

    def _start(self, lost: Wire | None) -> None:
        self._mender = threading.Thread(target=self._mend, args=(lost,), name="reopen", daemon=True)
        self._mender.start()

    def _mend(self, lost: Wire | None) -> None:
        if lost is not None:
            lost.close()
        pause_s, self._pause_s = self._pause_s, min(2.0 * self._pause_s, LONGEST_S)
        while not self._stop.wait(pause_s):
            try:
                self._wire = self._open_wire()
                return
            except LinkLost as error:
                self._why, pause_s = error.reason, self._first_s


class MendedStream(Mended[Stream]):
    """truearc.hw.protocols.Stream that comes back."""

    def read(self) -> bytes:
        return self.ask(lambda stream: stream.read())


class MendedCamera(Mended[Camera]):
    """truearc.hw.protocols.Camera that comes back.

    The image that it was lost with does not count when it comes again: a driver that hangs may hand out its last one
    for ever, also after it was opened again.
    """

    def __init__(self, open_camera: Callable[[], Camera], pause_s: float = PAUSE_S) -> None:
        self._newest: Image | None = None
        self._stale: Image | None = None          # what it was lost with, until there is another
        super().__init__(open_camera, pause_s)

    def read(self) -> CameraFrame | None:
        try:
            return self.ask(lambda camera: self._look(camera.read()))
        except LinkLost:
            self._stale = self._newest
            raise

    def _look(self, frame: CameraFrame | None) -> CameraFrame | None:
        if frame is None or (self._stale is not None and np.array_equal(frame.image, self._stale)):
            return None
        self._newest, self._stale = frame.image, None
        return frame
