"""A serial cable that is a pseudo-terminal. POSIX only; truearc.hw.emulated.serial_link has the portable stand-in."""

import contextlib
import fcntl
import os
import select
import struct
import termios
import tty

WAIT_S = 0.0005                                   # between looks at whether the bytes have arrived
LOOKS = 2000
UNREAD = 2048                                     # bytes; the kernel holds twice that, and then waits
FULL = 65536                                      # bytes that the kernel no longer takes: the rest is lost


class PtyCable:
    """A pseudo-terminal. Its reading end is kept open too, so that the line stays raw and a late reader misses none.

    `prompt`: what is written can be read when `write` returns; for a reader in the same thread, whose next tick must
    see it every time. Otherwise the kernel carries it across in its own time.
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
