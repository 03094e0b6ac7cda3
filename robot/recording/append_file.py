"""A file that only grows, on a disk that may refuse."""

import contextlib
import errno
import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import IO

from truearc.hw.reason import Reason
from truearc.robot.reasons import DISK_BACKLOG_FULL, FILE_DELETED, text

PENDING_BYTES = 64 << 20              # kept for a disk that takes nothing: some ten minutes of ticks
# Full, over its quota, read-only, or broken: a disk's own troubles, which may end; others are a wrong path.
DISK_ERRNOS = tuple(getattr(errno, name) for name in ("ENOSPC", "EDQUOT", "EROFS", "EIO") if hasattr(errno, name))


class NotKept(OSError):
    """Bytes cannot be kept, for a reason that no system call gives."""

    def __init__(self, reason: Reason) -> None:
        super().__init__(reason)
        self.reason = reason

    def __str__(self) -> str:
        return text(self.reason)


class Appender:
    """Keeps bytes that the disk does not take and writes them at the next `flush`: space made in time loses nothing.

    With more than `pending_bytes` waiting nothing further is taken, so what is on disk is always one whole beginning.
    A new file only; it stays locked, where the system has locks, until it is closed or its process has died.
    `prepare`: makes the file's folder when the first `flush` opens the file; without it the file is opened at once.
    """

    def __init__(self, path: Path, pending_bytes: int = PENDING_BYTES,
                 prepare: Callable[[], None] | None = None) -> None:
        self.path, self._pending_bytes, self._prepare = path, pending_bytes, prepare
        self._file: IO[bytes] | None = None
        self._opening = threading.Lock()
        self._pending = bytearray()
        self._on_disk = 0
        self._gave_up = False
        if prepare is None:
            self.ready()

    def write(self, data: bytes) -> int:
        self._gave_up = self._gave_up or len(self._pending) > self._pending_bytes
        if not self._gave_up:
            self._pending += data
        return len(data)

    def tell(self) -> int:
        return self._on_disk + len(self._pending)

    def flush(self) -> None:
        """Hand everything to the system, which keeps it whatever becomes of this process; OSError when it refuses.

        NotKept when the rest is not kept, or when the file has been deleted: writes would succeed, and no one could
        read them.
        """
        file = self.ready()
        while self._pending:
            taken = file.write(self._pending) or 0
            self._on_disk += taken
            del self._pending[:taken]
        if self._gave_up:
            raise NotKept(DISK_BACKLOG_FULL())
        if self._is_linked and not os.fstat(file.fileno()).st_nlink:
            raise NotKept(FILE_DELETED(file=self.path.name))

    def sync(self) -> None:
        """Wait until what was flushed would survive a power cut."""
        os.fsync(self.ready().fileno())

    def close(self) -> None:
        if self._file is not None:
            self._file.close()

    def ready(self) -> IO[bytes]:
        """Open the file, if it is not yet; OSError when that cannot be."""
        with self._opening:           # writing and syncing have threads of their own
            if self._file is None:
                if self._prepare is not None:
                    self._prepare()
                self._file = self.path.open("xb", buffering=0)
                with contextlib.suppress(OSError):           # a file system without locks
                    claim(self._file)
                self._is_linked = os.fstat(self._file.fileno()).st_nlink > 0     # not every file system counts
            return self._file


def claim(file: IO[bytes]) -> None:
    """Lock a file for whoever holds it open; BlockingIOError when someone else does. Nothing on Windows."""
    try:
        import fcntl
    except ImportError:
        return
    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
