"""Child processes, messages over socket pairs, and the latest values in shared memory.

This module starts, supervises and restarts child processes. Neither end of a connection ever waits for the other.
"""

import ctypes
import multiprocessing
import signal
import socket
import struct
import sys
import threading
from collections import deque
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np
import numpy.typing as npt

from truearc.hw import fault_codes, protocols, reason
from truearc.hw.real.clock import make_pauses_s

# --- a child

CONTEXT = multiprocessing.get_context("spawn")    # forking a process that has threads may hang the child
FIRST_S, LONGEST_S = 0.2, 5.0                     # pauses before it is started again
LOOK_S = 0.1                                      # how often a thread that waits for the first word looks up
ENDING_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")  # go to the whole group; who ends is the parent's to say
PR_SET_PDEATHSIG = 1
WORKS = "works"

Work = Callable[..., None]            # work(line, is_first, *args), importable by its name


class Line:
    """The child's end of the connection to its parent; nothing is ever sent to a child except the closing of the
    connection."""

    def __init__(self, connection: "Connection[Any, Any]") -> None:
        self._connection = connection

    def say(self, why_not: reason.Reason | None) -> None:
        """Report once that it works (None), or why it cannot."""
        try:
            self._connection.send(why_not)
        except OSError:               # the parent has gone: the next look at the line says so
            return

    def is_over(self, wait_s: float) -> bool:
        """Return whether the parent wants it to end or no longer exists; waits for that."""
        try:
            return self._connection.poll(wait_s)
        except OSError:
            return True


class Child:
    """A process that does `work` until `close`, or until this process no longer exists.

    `trouble` is what is wrong with it: it has not started yet, cannot, or has ended; None while it works. `restarts`:
    it is restarted after it ends, with pauses that grow while it fails. `mortal`: the system kills it, where it can,
    when this process dies; for work that has nothing to finish.

    A separate thread starts the process and waits for its end. It exists before real-time priority is requested, so
    that the child has ordinary priority on any core; and Linux treats the death of the thread that started a child as
    the parent's.
    """

    def __init__(self, name: str, work: Work, args: tuple[Any, ...], *, restarts: bool, mortal: bool) -> None:
        self.name = name
        self.trouble: reason.Reason | None = fault_codes.PROCESS_STARTING(process=name)
        self.pid: int | None = None
        self.starts = 0
        self._work, self._args, self._restarts, self._mortal = work, args, restarts, mortal
        self._answered, self._over = threading.Event(), threading.Event()
        self._lock = threading.Lock()
        self._line: Connection[Any, Any] | None = None
        self._process: BaseProcess | None = None
        self._thread = threading.Thread(target=self._keep, name=f"{name} process", daemon=True)
        self._thread.start()

    def wait(self) -> None:
        """Wait until it first works; LinkLost, with the reason, if it cannot."""
        self._answered.wait()
        if self.trouble is not None:
            raise protocols.LinkLost(self.trouble)

    def is_gone(self) -> bool:
        """Return whether it has ended for good."""
        return not self._restarts and self._answered.is_set() and not self._thread.is_alive()

    def close(self, patience_s: float) -> None:
        """Ask it to end, and kill it if that takes too long."""
        self._over.set()
        with self._lock:
            if self._line is not None:
                self._line.close()
        self._thread.join(patience_s)
        if self._thread.is_alive() and self._process is not None:
            self._process.kill()
            self._thread.join()

    def _keep(self) -> None:
        pauses_s = make_pauses_s(FIRST_S, LONGEST_S)
        while not self._over.is_set():
            worked = self._live_once()
            self._answered.set()
            if not self._restarts:
                return
            if worked:
                pauses_s = make_pauses_s(FIRST_S, LONGEST_S)
            self._over.wait(next(pauses_s))

    def _live_once(self) -> bool:
        """From a start to its end; whether it has worked between."""
        ours, theirs = CONTEXT.Pipe()
        work = (self._work, Line(theirs), self.starts == 0, self._mortal, self._args)
        process = CONTEXT.Process(target=_live, args=work, name=self.name, daemon=True)
        process.start()
        theirs.close()
        self.starts += 1
        with self._lock:
            self._line, self._process, self.pid = ours, process, process.pid
        said = self._listen(ours)
        process.join()
        if not isinstance(said, reason.Reason):          # why it cannot says more
            code = process.exitcode or 0
            self.trouble = (fault_codes.PROCESS_KILLED(process=self.name, signal=-code) if code < 0 else
                            fault_codes.PROCESS_ENDED(process=self.name, exit_code=code))
        with self._lock:
            ours.close()
        return said == WORKS

    def _listen(self, line: "Connection[Any, Any]") -> reason.Reason | str | None:
        """Its first word: WORKS, or its trouble; None when it has ended, or is to, without any."""
        try:
            while not self._over.is_set():
                if line.poll(LOOK_S):
                    said: reason.Reason | None = line.recv()
                    self.trouble = said
                    self._answered.set()
                    return said or WORKS
        except (OSError, EOFError):
            pass
        return None


def make_shared(size: int) -> Any:
    """Return `size` zero bytes that a child may share; the system frees them when no process holds them, however the
    processes ended."""
    return CONTEXT.RawArray(ctypes.c_ubyte, size)


def _live(work: Work, line: Line, is_first: bool, mortal: bool, args: tuple[Any, ...]) -> None:
    for name in ENDING_SIGNALS:
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    if mortal and sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    work(line, is_first, *args)


# --- messages

LENGTH_BYTES = 4
CHUNK = 1 << 20
ROOM = 4 << 20                        # bytes requested from the system for messages on their way; it may give less


class Outbox:
    """Sends what the system accepts, and keeps the rest for the next `push`.

    Accepted bytes reach the other end whatever happens to this process. `waiting`: bytes not yet accepted.
    """

    def __init__(self, end: socket.socket) -> None:
        self.waiting = 0
        self._end = end
        end.setblocking(False)
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, ROOM)
        self._parts: deque[memoryview] = deque()

    def put(self, message: bytes) -> None:
        part = memoryview(len(message).to_bytes(LENGTH_BYTES, "little") + message)
        self._parts.append(part)
        self.waiting += len(part)
        self.push()

    def push(self) -> None:
        """Send on; do nothing once the reader has gone."""
        while self._parts:
            try:
                taken = self._end.send(self._parts[0])
            except OSError:           # full, or broken: what became of the reader others know
                return
            self.waiting -= taken
            rest = self._parts.popleft()[taken:]
            if rest:
                self._parts.appendleft(rest)

    def close(self) -> None:
        self._end.close()


class Inbox:
    """The receiving end."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end
        self._pending = bytearray()

    def read(self, wait_s: float) -> list[bytes]:
        """Return complete messages, waiting this long for the first bytes; LinkLost when there will be no more."""
        self._end.settimeout(wait_s)
        try:
            data = self._end.recv(CHUNK)
        except TimeoutError:
            return []
        except OSError as error:
            raise protocols.LinkLost(fault_codes.PIPE_CLOSED(detail=str(error))) from error
        if not data:
            raise protocols.LinkLost(fault_codes.PIPE_ENDED())
        self._pending += data
        return self._whole()

    def close(self) -> None:
        self._end.close()

    def _whole(self) -> list[bytes]:
        messages, at = [], 0
        while (begin := at + LENGTH_BYTES) <= len(self._pending):
            end = begin + int.from_bytes(self._pending[at:begin], "little")
            if end > len(self._pending):
                break
            messages.append(bytes(self._pending[begin:end]))
            at = end
        del self._pending[:at]
        return messages


# --- newest values

HEAD = 16                             # bytes: number of the newest, when its writer was last seen alive
SLOT = struct.Struct("<IqIIII")       # checksum of header and text, number, bytes of text; height, width, checksum
COLOURS = 3


class Capacity(NamedTuple):
    """The available room. `places`: an image is overwritten after this number of messages."""

    places: int
    text_bytes: int
    image_bytes: int = 0

    @property
    def slot_bytes(self) -> int:
        return SLOT.size + self.text_bytes + self.image_bytes

    @property
    def bytes(self) -> int:
        return HEAD + self.places * self.slot_bytes


class Slots:
    """A ring of slots with one writer and one reader, each with a Slots of its own on the same memory (whatever has a
    writable buffer).

    Checksums tell the reader what is not whole yet, or no longer: not every machine promises in what order another core
    sees writes. Memory is all zeros at first; a writer that takes another's place goes on where that one ended.
    """

    def __init__(self, memory: Any, room: Capacity) -> None:
        self._room = room
        self._memory = memoryview(memory).cast("B")
        self._head = self._memory[:HEAD].cast("q")
        self._read = 0

    def put(self, text: bytes, image: npt.NDArray[np.uint8] | None = None) -> None:
        """Write a message, with an image of (height, width, 3) or none; ValueError if there is no room for it."""
        pixels = b"" if image is None else np.ascontiguousarray(image).reshape(-1).data
        if len(text) > self._room.text_bytes or len(pixels) > self._room.image_bytes:
            raise ValueError(f"{len(text)} and {len(pixels)} bytes where there is room for {self._room[1:]}")
        number = self._head[0] + 1
        height, width = (0, 0) if image is None else image.shape[:2]
        rest = SLOT.pack(0, number, len(text), height, width, crc32(pixels))[4:] + text
        at, images = self._places(number)
        self._memory[at:at + 4 + len(rest)] = struct.pack("<I", crc32(rest)) + rest
        self._memory[images:images + len(pixels)] = pixels
        self._head[0] = number

    def read(self) -> bytes | None:
        """Return the newest message, once; None if there is nothing new."""
        number = self._head[0]
        if number == self._read:
            return None
        text = self._text(number)
        if text is not None:
            self._read = number
        return text

    def image(self) -> npt.NDArray[np.uint8] | None:
        """Return a copy of the image of the message read last; None if it had none, or it has been overwritten."""
        at, images = self._places(self._read)
        _, _, _, height, width, checksum = SLOT.unpack_from(self._memory, at)
        size = height * width * COLOURS
        if not size or size > self._room.image_bytes:
            return None
        pixels = np.frombuffer(self._memory[images:images + size], dtype=np.uint8).copy()
        if self._text(self._read) is None or crc32(pixels.data) != checksum:
            return None
        return pixels.reshape(height, width, COLOURS)

    def beat(self, t_ns: int) -> None:
        """Note that the writer is alive."""
        self._head[1] = t_ns

    def beaten_ns(self) -> int:
        """Return when the writer last noted that it is alive; 0 = never."""
        return int(self._head[1])

    def _places(self, number: int) -> tuple[int, int]:
        """Where a slot and its image begin."""
        at = HEAD + number % self._room.places * self._room.slot_bytes
        return at, at + SLOT.size + self._room.text_bytes

    def _text(self, number: int) -> bytes | None:
        """The text of slot `number`; None when that is not there, or not whole."""
        at, images = self._places(number)
        slot = bytes(self._memory[at:images])
        checksum, found, length, *_ = SLOT.unpack_from(slot)
        whole = slot[4:SLOT.size + length]
        return whole[SLOT.size - 4:] if found == number and crc32(whole) == checksum else None
