"""The files of a session: made, written, and never written over."""

import contextlib
import os
import shutil
import struct
import threading
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO

import cv2
import msgspec
import numpy as np
from mcap.writer import CompressionType, Writer

from truearc.errors import NO_JSON, InputError, load_bytes
from truearc.hw.protocols import CameraFrame, Frame
from truearc.robot.config.hashing import table_of
from truearc.robot.config.schema import Config
from truearc.robot.reasons import IMAGE_NOT_ENCODED
from truearc.robot.recording import session as layout
from truearc.robot.recording.append_file import DISK_ERRNOS, Appender, NotKept
from truearc.robot.recording.candump import candump_line
from truearc.robot.recording.rows import RowFormat, Rows2, Trial
from truearc.robot.recording.session import Header, Picture
from truearc.robot.types import Tick

PNG, PNG_SIZE_AT = b"\x89PNG\r\n\x1a\n", 16
MOST_PIXELS = 1 << 25                 # of an image, 100 MB; no camera's frame has as many
AGAIN = 10                            # a folder that found no room is tried again at every tenth need of it: a second
# t_ns, the encoded Tick, its raw frames, its encoded trials
Row = tuple[int, bytes, list[tuple[Frame, bool]], list[bytes]]


class TickFile:
    """telemetry.mcap: a message per tick on /tick, one per marked trial on /trial.

    Every `flush` ends a chunk, so that what is before it can be read. `mcap`: its writer, for further topics.
    """

    def __init__(self, file: IO[bytes] | Appender, rows: RowFormat) -> None:
        self._file, self._written = file, Counter[int]()
        self.mcap = Writer(file, compression=CompressionType.ZSTD)
        self.mcap.start(profile="", library="truearc")
        self._ticks, self._trials = (
            self.mcap.register_channel(topic, "json", self.mcap.register_schema(
                f"truearc.{kind.__name__}", "jsonschema", rows.schema(kind)))
            for topic, kind in ((layout.TICK_TOPIC, Tick), (layout.TRIAL_TOPIC, Trial)))

    def write(self, t_ns: int, row: bytes, trials: Sequence[bytes] = ()) -> None:
        """Add a tick and the trials that were marked in it."""
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
        self._ticks = TickFile(self._telemetry, Rows2())
        self.trials_kept = self._trials_written = 0
        try:
            for file in self._files:
                file.ready()
        except OSError as error:
            if not waits or error.errno not in DISK_ERRNOS:
                raise
            self.unmade = error

    def _make(self) -> None:
        """Make the folder if it is not there yet; any lane may be the first that can."""
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
            raise NotKept(IMAGE_NOT_ENCODED(file=name))
        (self._folder / layout.FRAMES / name).write_bytes(png.tobytes())
        self._index.write(msgspec.json.encode(Picture(picture.t_ns, name)) + b"\n")
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


def session_contents(header: Header, config: Config, model: bytes | None = None,
                     aim: bytes | None = None) -> dict[str, bytes]:
    """Name -> bytes of a session's files that do not grow. The header comes last: it makes the folder a session."""
    contents = {layout.CONFIG: _make_json(table_of(config)), layout.MODEL: model, layout.AIM: aim,
                layout.HEADER: _make_json(header)}
    return {name: data for name, data in contents.items() if data is not None}


def make_folder(folder: Path, contents: Mapping[str, bytes]) -> None:
    """A session's folder with those files; nothing stays of one that cannot be made whole.

    InputError when it is there already; OSError, which names the file, when it cannot be made.
    """
    if folder.exists():
        raise InputError(f"{folder}: exists already; a recording is never written over")
    path = folder / layout.FRAMES
    try:
        path.mkdir(parents=True)
        for name, data in contents.items():
            save_synced(path := folder / name, data)
    except OSError as error:
        shutil.rmtree(folder, ignore_errors=True)
        raise OSError(error.errno, error.strerror, str(path)) from error


def append_trials(folder: Path, rows: list[bytes]) -> None:
    """Add rows that whoever wrote the trials did not come to; half a row at the end gives way to them."""
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


def load_pictures(session: Path) -> list[Picture]:
    """The index of the images, oldest first; a line that is torn names none."""
    path, pictures = session / layout.INDEX, []
    for line in load_bytes(path).split(b"\n") if path.exists() else []:
        with contextlib.suppress(*NO_JSON):
            pictures.append(msgspec.json.decode(line, type=Picture))
    return pictures


def load_image(session: Path, picture: Picture) -> CameraFrame | None:
    """One image as it was seen; None when the file is missing, no PNG, which is what we write, or too large."""
    path = session / layout.FRAMES / picture.file
    data = load_bytes(path) if path.is_file() else b""
    is_png = data.startswith(PNG) and len(data) >= PNG_SIZE_AT + 8
    width_px, height_px = struct.unpack_from(">II", data, PNG_SIZE_AT) if is_png else (0, 0)
    is_small = 0 < width_px * height_px < MOST_PIXELS
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) if is_small else None
    return None if image is None else CameraFrame(picture.t_ns, np.asarray(image, dtype=np.uint8))


def _make_json(value: object) -> bytes:
    return msgspec.json.format(msgspec.json.encode(value)) + b"\n"
