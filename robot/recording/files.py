"""The files of a session, which are created and appended to but never overwritten.

`Appender` appends to the files and survives a full disk. Raw CAN frames are stored as candump text,
`(seconds.microseconds) can0 ID#DATA R|T`, which can-utils, SavvyCAN and python-can can read.
"""

import contextlib
import errno
import os
import re
import shutil
import struct
import threading
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import IO

import cv2
import msgspec
import numpy as np
from mcap.writer import CompressionType, Writer

from truearc.errors import NO_JSON, InputError, load_bytes
from truearc.hw.protocols import Bus, CameraFrame, Frame
from truearc.hw.reason import Reason
from truearc.robot import reasons, types
from truearc.robot.config.schema import Config, plain_table
from truearc.robot.recording import session as layout

PENDING_BYTES = 64 << 20              # kept for a disk that takes nothing: some ten minutes of ticks
# Full, over its quota, read-only, or broken: a disk's own troubles, which may end; others are a wrong path.
DISK_ERRNOS = tuple(getattr(errno, name) for name in ("ENOSPC", "EDQUOT", "EROFS", "EIO") if hasattr(errno, name))
_LINE = re.compile(r"\((\d{1,10})\.(\d{6})\) [!-~]+ ([0-9A-F]{3}|[0-9A-F]{8})#(R[1-8]?|(?:[0-9A-F]{2}){0,64}) ([RT])\n")
PNG, PNG_SIZE_AT = b"\x89PNG\r\n\x1a\n", 16
MOST_PIXELS = 1 << 25                 # of an image, 100 MB; no camera's frame has as many
AGAIN = 10                            # a folder that found no room is tried again at every tenth need of it: a second
# t_ns, the encoded Tick, its raw frames, its encoded trials
Row = tuple[int, bytes, list[tuple[Frame, bool]], list[bytes]]


class NotKept(OSError):
    """Bytes cannot be kept, for a reason that no system call reports."""

    def __init__(self, reason: Reason) -> None:
        super().__init__(reason)
        self.reason = reason

    def __str__(self) -> str:
        return reasons.text(self.reason)


class Appender:
    """Keeps bytes that the disk refuses and writes them at the next `flush`: nothing is lost if space is made in time.

    With more than `pending_bytes` waiting, further bytes are refused, so the disk always holds one unbroken beginning.
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
        """Pass everything to the system, which keeps it even if this process dies; OSError if it refuses.

        NotKept if the rest is not kept, or if the file has been deleted: writes would succeed, but nobody could read
        them.
        """
        file = self.ready()
        while self._pending:
            taken = file.write(self._pending) or 0
            self._on_disk += taken
            del self._pending[:taken]
        if self._gave_up:
            raise NotKept(reasons.DISK_BACKLOG_FULL())
        if self._is_linked and not os.fstat(file.fileno()).st_nlink:
            raise NotKept(reasons.FILE_DELETED(file=self.path.name))

    def sync(self) -> None:
        """Wait until flushed data would survive a power cut."""
        os.fsync(self.ready().fileno())

    def close(self) -> None:
        if self._file is not None:
            self._file.close()

    def ready(self) -> IO[bytes]:
        """Open the file if it is not open; OSError if that fails."""
        with self._opening:           # writing and syncing have threads of their own
            if self._file is None:
                if self._prepare is not None:
                    self._prepare()
                self._file = self.path.open("xb", buffering=0)
                with contextlib.suppress(OSError):           # a file system without locks
                    claim(self._file)
                self._is_linked = os.fstat(self._file.fileno()).st_nlink > 0     # not every file system counts
            return self._file


def lock_trouble(path: Path) -> OSError | None:
    """Return why a file cannot be locked, BlockingIOError while another process writes it; None if it can."""
    try:
        with path.open("rb") as file:
            claim(file)
    except OSError as error:
        return error
    return None


def claim(file: IO[bytes]) -> None:
    """Lock an open file; BlockingIOError when another process has locked it. Does nothing on Windows."""
    try:
        import fcntl
    except ImportError:
        return
    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def candump_line(frame: Frame, sent: bool, t_ns: int) -> str:
    """Return one line of text with the rig's monotonic time: of receipt, or of the tick that sent the frame."""
    t_ns = t_ns if sent else frame.t_ns
    name = f"{frame.arbitration_id:08X}" if frame.is_extended else f"{frame.arbitration_id:03X}"
    data = f"R{len(frame.data) or ''}" if frame.is_remote else frame.data.hex().upper()
    return f"({t_ns // 1_000_000_000}.{t_ns // 1000 % 1_000_000:06d}) can0 {name}#{data} {'T' if sent else 'R'}\n"


def parse_candump(line: str) -> tuple[Frame, bool] | None:
    """Return the frame that `candump_line` wrote, and whether it was sent; None for any other or truncated line."""
    match = _LINE.fullmatch(line)
    if match is None:
        return None
    seconds, micros, name, data, way = match.groups()
    remote = data.startswith("R")                 # a question has the length of its answer
    content = bytes(int(data[1:] or 0)) if remote else bytes.fromhex(data)
    frame = Frame(int(seconds) * 1_000_000_000 + int(micros) * 1000, int(name, 16), content, len(name) == 8, remote)
    return (frame._replace(t_ns=0) if way == "T" else frame), way == "T"


class TappedBus:
    """A bus that passes every frame to `tap(frame, sent)`."""

    def __init__(self, bus: Bus, tap: Callable[[Frame, bool], None]) -> None:
        self._bus, self._tap = bus, tap

    def read(self) -> list[Frame]:
        frames = self._bus.read()
        for frame in frames:
            self._tap(frame, False)
        return frames

    def write(self, frame: Frame) -> bool:
        taken = self._bus.write(frame)
        if taken:
            self._tap(frame, True)
        return taken

    def faults(self) -> list[Reason]:
        return self._bus.faults()


class TickFile:
    """telemetry.mcap: a message per tick on /tick, one per marked trial on /trial.

    Every `flush` ends a chunk, so that what is before it can be read. `mcap`: its writer, for further topics.
    """

    def __init__(self, file: IO[bytes] | Appender) -> None:
        self._file, self._written = file, Counter[int]()
        self.mcap = Writer(file, compression=CompressionType.ZSTD)
        self.mcap.start(profile="", library="truearc")
        self._ticks, self._trials = (
            self.mcap.register_channel(topic, "json", self.mcap.register_schema(
                f"truearc.{kind.__name__}", "jsonschema", layout.row_schema(kind)))
            for topic, kind in ((layout.TICK_TOPIC, types.Tick), (layout.TRIAL_TOPIC, layout.Trial)))

    def write(self, t_ns: int, row: bytes, trials: Sequence[bytes] = ()) -> None:
        """Add a tick and the trials marked in it."""
        self._add(self._ticks, t_ns, row)
        for trial in trials:
            self.write_trial(t_ns, trial)

    def write_trial(self, t_ns: int, row: bytes) -> None:
        self._add(self._trials, t_ns, row)

    def flush(self) -> None:
        self.mcap.flush()

    def finish(self) -> None:
        """Write the summary that makes the file whole."""
        self.mcap.finish()
        self._file.flush()

    def _add(self, channel: int, t_ns: int, row: bytes) -> None:
        self.mcap.add_message(channel, log_time=t_ns, data=row, publish_time=t_ns, sequence=self._written[channel])
        self._written[channel] += 1


class SessionFiles:
    """The open files of a layout. Each method is called by one lane only, except the fsyncs, which any may call.

    `trials_kept`: how many of the trials that were written the system has. `contents`: name -> bytes of the files that
    do not grow. `waits`: on a disk that has no room yet the folder is made later, and until then ticks and trials are
    kept here; `unmade` is then why. OSError, or InputError, when it cannot be made.
    """

    def __init__(self, folder: Path, contents: Mapping[str, bytes], waits: bool) -> None:
        self.unmade: OSError | None = None
        self._folder, self._contents = folder, contents
        self._making, self._is_made, self._needs = threading.Lock(), False, 0
        self._telemetry, self._can, self._trials, self._index = self._files = tuple(
            Appender(folder / name, prepare=self._make)
            for name in (layout.TELEMETRY, layout.CAN, layout.TRIALS, layout.INDEX))
        self._ticks = TickFile(self._telemetry)
        self.trials_kept = self._trials_written = 0
        try:
            for file in self._files:
                file.ready()
        except OSError as error:
            if not waits or error.errno not in DISK_ERRNOS:
                raise
            self.unmade = error

    def _make(self) -> None:
        """Make the folder if it does not exist yet; any lane may be the first to succeed."""
        with self._making:
            if self._is_made:
                return
            self._needs += 1
            if self.unmade is not None and self._needs % AGAIN:
                raise OSError(self.unmade.errno, self.unmade.strerror)
            make_folder(self._folder, self._contents)
            self._is_made, self.unmade = True, None

    def write_ticks(self, rows: list[Row]) -> None:
        for t_ns, row, frames, trials in rows:
            self._can.write("".join([candump_line(frame, sent, t_ns) for frame, sent in frames]).encode("ascii"))
            self._ticks.write(t_ns, row, trials)
        try:
            self._can.flush()         # first, so that a tick on disk has its frames there too
        finally:
            self._ticks.flush()

    def write_trial(self, row: bytes, written: threading.Event) -> None:
        self._trials.write(row + b"\n")
        self._trials_written += 1
        try:
            self.flush_trials()
        finally:
            written.set()

    def flush_trials(self) -> None:
        self._trials.flush()
        self.trials_kept = self._trials_written

    def sync_trials(self) -> None:
        self._trials.sync()

    def sync(self) -> None:
        for file in (self._trials, self._telemetry, self._can):
            file.sync()

    def write_picture(self, picture: CameraFrame) -> None:
        self._make()
        name = f"{picture.t_ns // 1_000_000:09d}.png"
        done, png = cv2.imencode(".png", picture.image, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        if not done:
            raise NotKept(reasons.IMAGE_NOT_ENCODED(file=name))
        (self._folder / layout.FRAMES / name).write_bytes(png.tobytes())
        self._index.write(layout.encode_row(layout.Picture(picture.t_ns, name)) + b"\n")
        self._index.flush()

    def write_lateness(self, row: bytes) -> None:
        self._make()
        with (self._folder / layout.LATENESS).open("ab") as file:
            file.write(row + b"\n")

    def finish(self) -> None:
        self._ticks.finish()

    def close(self) -> None:
        self._needs = AGAIN - 1       # the last chance
        try:
            for file in self._files:
                file.flush()
                file.sync()
        finally:
            for file in self._files:
                file.close()


def session_contents(header: layout.Header, config: Config, model: bytes | None = None,
                     aim: bytes | None = None) -> dict[str, bytes]:
    """Return name -> bytes of a session's fixed files. The header comes last: it makes the folder a session."""
    config_json, header_json = (msgspec.json.format(layout.encode_row(value)) + b"\n"
                                for value in (plain_table(config), header))
    contents = {layout.CONFIG: config_json, layout.MODEL: model, layout.AIM: aim, layout.HEADER: header_json}
    return {name: data for name, data in contents.items() if data is not None}


def make_folder(folder: Path, contents: Mapping[str, bytes]) -> None:
    """Make a session's folder with those files, or leave nothing behind.

    InputError when it already exists; OSError, which names the file, when it cannot be made.
    """
    if folder.exists():
        raise InputError(f"{folder}: already exists; a recording is never overwritten")
    path = folder / layout.FRAMES
    try:
        path.mkdir(parents=True)
        for name, data in contents.items():
            save_synced(path := folder / name, data)
    except OSError as error:
        shutil.rmtree(folder, ignore_errors=True)
        raise OSError(error.errno, error.strerror, str(path)) from error


def append_trials(folder: Path, rows: list[bytes]) -> None:
    """Append the rows that the writer of the trials did not reach, replacing a truncated last row."""
    with (folder / layout.TRIALS).open("r+b") as file:
        whole = file.read().rfind(b"\n") + 1
        file.seek(whole)
        file.truncate()
        file.write(b"".join(row + b"\n" for row in rows))
        file.flush()
        os.fsync(file.fileno())


def save_synced(path: Path, data: bytes) -> None:
    """Write a new file, and wait until it would survive a power cut."""
    with path.open("xb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def load_pictures(session: Path) -> list[layout.Picture]:
    """Load the index of the images, oldest first; truncated lines are skipped."""
    path, pictures = session / layout.INDEX, []
    for line in load_bytes(path).split(b"\n") if path.exists() else []:
        with contextlib.suppress(*NO_JSON):
            pictures.append(msgspec.json.decode(line, type=layout.Picture))
    return pictures


def load_image(session: Path, picture: layout.Picture) -> CameraFrame | None:
    """Load one image as recorded; None if the file is missing, too large, or not a PNG."""
    path = session / layout.FRAMES / picture.file
    data = load_bytes(path) if path.is_file() else b""
    is_png = data.startswith(PNG) and len(data) >= PNG_SIZE_AT + 8
    width_px, height_px = struct.unpack_from(">II", data, PNG_SIZE_AT) if is_png else (0, 0)
    is_small = 0 < width_px * height_px < MOST_PIXELS
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) if is_small else None
    return None if image is None else CameraFrame(picture.t_ns, np.asarray(image, dtype=np.uint8))
