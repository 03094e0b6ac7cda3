"""Disks that break under a recording."""

import errno
import os
import resource
import subprocess
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.matrix.span import Span
from truearc.robot.recording.writer import SessionWriter

DISK_MB = 48
WAIT_S = 0.005


def mount_small_disk(folder: Path) -> bool:
    """A disk of its own at `folder`, where this user may have one; ENOSPC is real there."""
    command = ["mount", "-t", "tmpfs", "-o", f"size={DISK_MB}m", "truearc-small-disk", str(folder)]
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


def unmount(folder: Path) -> None:
    subprocess.run(["umount", "-l", str(folder)], capture_output=True, check=False)


def break_disk(recorder: SessionWriter, what: str, span: Span) -> Callable[[], None]:
    """Break it as long as the span stands; what ends that for good is returned."""
    if what in ("hangs", "turns read-only"):
        files = recorder._keeper._files
        for appender in (files._telemetry, files._can, files._trials, files._index):
            appender._file = _BadFile(appender._file, what, span)
        return lambda: None
    over = threading.Event()
    work = {"full": _fill, "loses a folder": _lose}[what]
    thread = threading.Thread(target=_wait_and, args=(work, recorder.folder, span, over), daemon=True)
    thread.start()

    def end() -> None:
        over.set()
        thread.join()
    return end


class _BadFile:
    """An open file that hangs or refuses."""

    def __init__(self, file: Any, what: str, span: Span) -> None:
        self._file, self._what, self._span = file, what, span
        self._wait = threading.Event()

    def write(self, data: bytes) -> int:
        while self._what == "hangs" and self._span.stands():
            self._wait.wait(WAIT_S)
        if self._what == "turns read-only" and self._span.stands():
            raise OSError(errno.EROFS, os.strerror(errno.EROFS))
        return int(self._file.write(data))

    def fileno(self) -> int:
        return int(self._file.fileno())

    def close(self) -> None:
        self._file.close()


def _wait_and(work: Callable[[Path, bool], None], folder: Path, span: Span, over: threading.Event) -> None:
    while not span.stands():
        if over.wait(WAIT_S):
            return
    work(folder, True)
    while span.stands() and not over.wait(WAIT_S):
        pass
    work(folder, False)


def _fill(folder: Path, begins: bool) -> None:
    """A real ENOSPC where the disk is small; else no file of this process may grow (EFBIG)."""
    ballast = folder.parent / "ballast"
    if os.path.ismount(folder.parent):
        if not begins:
            ballast.unlink()
            return
        with ballast.open("wb", buffering=0) as file:
            for size in (1 << 20, 1 << 12, 1):
                try:
                    while True:
                        file.write(bytes(size))
                except OSError:
                    continue
        return
    largest = max(path.stat().st_size for path in folder.iterdir()) if begins else resource.RLIM_INFINITY
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 if begins else largest, resource.RLIM_INFINITY))


def _lose(folder: Path, begins: bool) -> None:
    here, there = folder / "frames", folder / "frames-away"
    (here if begins else there).rename(there if begins else here)
