"""Wires that are opened again, by a thread of their own, when they were lost: unplugged, and plugged in again."""

import threading
from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

from hw.link import Camera, LinkLost, Stream
from hw.reading import CameraFrame

PAUSE_S = 0.5                                     # between tries; an open camera takes about as long


class Closable(Protocol):
    def close(self) -> None: ...


Wire = TypeVar("Wire", bound=Closable)
Answer = TypeVar("Answer")


class Mended(Generic[Wire]):
    """An open wire, opened again by `open_again` (which raises LinkLost until it can) whenever it is lost."""

    def __init__(self, wire: Wire, open_again: Callable[[], Wire], pause_s: float = PAUSE_S) -> None:
        self._wire: Wire | None = wire
        self._open_again, self._pause_s = open_again, pause_s
        self._why = ""
        self._stop = threading.Event()
        self._mender: threading.Thread | None = None

    def ask(self, question: Callable[[Wire], Answer]) -> Answer:
        """What `question` makes of the wire; LinkLost, every time, from when it is lost until it is open again."""
        wire = self._wire
        if wire is None:
            raise LinkLost(self._why)
        try:
            return question(wire)
        except LinkLost as error:
            self._why, self._wire = str(error), None
            self._mender = threading.Thread(target=self._mend, args=(wire,), name="reopen", daemon=True)
            self._mender.start()
            raise

    def close(self) -> None:
        self._stop.set()
        if self._mender is not None:
            self._mender.join()
        if self._wire is not None:
            self._wire.close()

    def _mend(self, lost: Wire) -> None:
        lost.close()
        while not self._stop.wait(self._pause_s):
            try:
                self._wire = self._open_again()
                return
            except LinkLost as error:
                self._why = str(error)


class MendedStream:
    """hw.link.Stream that comes back."""

    def __init__(self, open_stream: Callable[[], Stream], pause_s: float = PAUSE_S) -> None:
        """Opens it the first time, too; LinkLost when that fails."""
        self._wire = Mended(open_stream(), open_stream, pause_s)

    def read(self) -> bytes:
        return self._wire.ask(lambda stream: stream.read())

    def write(self, data: bytes) -> None:
        self._wire.ask(lambda stream: stream.write(data))

    def close(self) -> None:
        self._wire.close()


class MendedCamera:
    """hw.link.Camera that comes back."""

    def __init__(self, open_camera: Callable[[], Camera], pause_s: float = PAUSE_S) -> None:
        """Opens it the first time, too; LinkLost when that fails."""
        self._wire = Mended(open_camera(), open_camera, pause_s)

    def read(self) -> CameraFrame | None:
        return self._wire.ask(lambda camera: camera.read())

    def close(self) -> None:
        self._wire.close()
