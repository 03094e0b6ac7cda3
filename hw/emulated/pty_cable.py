"""A serial cable that is a pseudo-terminal. POSIX only; hw.emulated.serial_port has the portable stand-in."""

import fcntl
import os
import select
import struct
import termios
import tty

WAIT_S = 0.0005                                   # between looks at whether the bytes have arrived
LOOKS = 2000
FULL = 2048                                       # bytes unread; the kernel holds twice that, and then waits


class PtyCable:
    """A pseudo-terminal. Its reading end is kept open too, so that the line stays raw and a late reader misses none."""

    def __init__(self) -> None:
        self._far, self._near = os.openpty()
        tty.setraw(self._near)
        self.port = os.ttyname(self._near)

    def write(self, data: bytes) -> None:
        waiting = self._waiting()
        if waiting > FULL:
            return                                          # nobody has read for a long time: the line is lost
        sent = os.write(self._far, data)
        # The kernel carries bytes across in its own time; a tick that follows must see them, every time.
        for _ in range(LOOKS):
            if self._waiting() >= waiting + sent:
                return
            select.select([], [], [], WAIT_S)

    def close(self) -> None:
        os.close(self._far)
        os.close(self._near)

    def _waiting(self) -> int:
        return int(struct.unpack("i", fcntl.ioctl(self._near, termios.FIONREAD, b"\0\0\0\0"))[0])
