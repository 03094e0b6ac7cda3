"""Writes a session. The tick only encodes and hands over; three threads own the files.

Ticks and CAN frames are handed to the system every tenth of a second, trials at once. What may take long, pictures and
every fsync, has a thread to itself, so that neither of the others waits for it.
"""

import os
import threading
from functools import partial
from pathlib import Path

import cv2
import msgspec
from mcap.writer import CompressionType, Writer

from hw.link import Frame
from hw.reading import CameraFrame
from robot.config import BadInput, Config, in_words
from robot.lateness import Second
from robot.recording.appender import Appender
from robot.recording.candump import candump_line
from robot.recording.lane import Lane
from robot.recording.session import (
    CAN,
    CONFIG,
    FRAMES,
    HEADER,
    INDEX,
    LATENESS,
    MODEL,
    TELEMETRY,
    TRIALS,
    Header,
    Picture,
    make_trials,
)
from robot.types import Sent, Tick

BATCH_NS = 100_000_000                # handed over together: a wake-up a tick would cost the loop its rhythm
SYNC_NS = 1_000_000_000               # a power cut may cost this much
MARK_S = 0.01                         # a tick waits no longer for its trial to be written; usually under 1 ms
SLOW_JOBS = 20                        # two seconds of batches wait: the disk does not answer
Row = tuple[int, bytes, list[tuple[Frame, bool]]]     # t_ns, the encoded Tick, raw frames of the tick


class SessionWriter:
    """A Recorder that keeps everything in a folder made for it; BadInput when that cannot be made.

    A process that is killed loses no tick older than a fifth of a second, and no trial: `record` returns when the
    system has its row, unless the disk stalls for longer than MARK_S. `lossless`: whatever the disk does, the caller
    waits and nothing is dropped; for the twin, whose time can wait. `trouble` says in words why ticks or trials are not
    reaching the disk; after `close`, `failed` does.
    """

    def __init__(self, folder: Path, header: Header, config: Config, model: bytes | None, lossless: bool) -> None:
        self.folder = folder
        _make_folder(folder, header, config, model)
        self.failed: Exception | None = None
        self._lossless = lossless
        self._encoder = msgspec.json.Encoder()
        self._frames: list[tuple[Frame, bool]] = []
        self._rows: list[Row] = []
        self._synced_ns = 0
        self._files = _Files(folder)
        self._ticks, self._trials, self._slow = (Lane(name, lossless) for name in ("ticks", "trials", "pictures"))
        self._lanes = (self._ticks, self._trials, self._slow)

    @property
    def dropped(self) -> int:
        """Batches, trials and pictures lost because the disk was too slow."""
        return sum(lane.dropped for lane in self._lanes)

    def trouble(self) -> str:
        """Why what is recorded is not reaching the disk, or ''."""
        for lane in self._lanes:
            if (error := lane.trouble) is not None:
                return in_words(error)
        return "the disk does not answer" if max(lane.waiting() for lane in self._lanes) > SLOW_JOBS else ""

    def tap(self, frame: Frame, sent: bool) -> None:
        """Keep one raw CAN frame; `sent` tells ours from the devices'."""
        self._frames.append((frame, sent))

    def record(self, tick: Tick, sent: Sent) -> None:
        t_ns = tick.inputs.t_ns
        for trial in make_trials(tick):
            self._record_trial(self._encoder.encode(trial))
        frames, self._frames = self._frames, []
        self._rows.append((t_ns, self._encoder.encode(msgspec.structs.replace(tick, sent=sent)), frames))
        if t_ns - self._rows[0][0] >= BATCH_NS:
            self._hand_rows()
        if t_ns - self._synced_ns >= SYNC_NS:
            self._synced_ns = t_ns
            self._trials.hand(self._files.flush_trials)
            self._slow.hand(self._files.sync)

    def keep_picture(self, picture: CameraFrame) -> None:
        self._slow.hand(partial(self._files.write_picture, picture))

    def keep_lateness(self, second: Second) -> None:
        self._slow.hand(partial(self._files.write_lateness, self._encoder.encode(second)))

    def close(self) -> None:
        """Write out what waits and close the files."""
        self._hand_rows()
        self._ticks.hand(self._files.finish)
        for lane in self._lanes:
            lane.close()
        troubles = [lane.trouble for lane in self._lanes if lane.trouble is not None]
        try:
            self._files.close()
        except OSError as error:
            troubles.append(error)
        self.failed = troubles[0] if troubles else None

    def _record_trial(self, row: bytes) -> None:
        written = threading.Event()
        self._trials.hand(partial(self._files.write_trial, row, written))
        written.wait(None if self._lossless else MARK_S)
        self._slow.hand(self._files.sync_trials)

    def _hand_rows(self) -> None:
        rows, self._rows = self._rows, []
        self._ticks.hand(partial(self._files.write_ticks, rows))


class TickFile:
    """telemetry.mcap: one message a tick; every `flush` ends a chunk, so that what is before it can be read."""

    def __init__(self, path: Path) -> None:
        self.file = Appender(path)
        self._mcap = Writer(self.file, compression=CompressionType.ZSTD)
        self._mcap.start(profile="", library="truearc")
        schema = msgspec.json.encode(msgspec.json.schema(Tick))
        schema_id = self._mcap.register_schema("truearc.Tick", "jsonschema", schema)
        self._channel = self._mcap.register_channel("/tick", "json", schema_id)
        self._ticks = 0

    def write(self, t_ns: int, row: bytes) -> None:
        self._mcap.add_message(self._channel, log_time=t_ns, data=row, publish_time=t_ns, sequence=self._ticks)
        self._ticks += 1

    def flush(self) -> None:
        self._mcap.flush()

    def finish(self) -> None:
        """Write the summary that makes the file whole."""
        self._mcap.finish()
        self.file.flush()


class _Files:
    """The open files of a session. Each method is called by one lane only, but for the fsyncs, which any may call."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._telemetry = TickFile(folder / TELEMETRY)
        self._can, self._trials = Appender(folder / CAN), Appender(folder / TRIALS)
        self._index = Appender(folder / FRAMES / INDEX)

    def write_ticks(self, rows: list[Row]) -> None:
        for t_ns, row, frames in rows:
            self._can.write("".join([candump_line(frame, sent, t_ns) for frame, sent in frames]).encode("ascii"))
            self._telemetry.write(t_ns, row)
        try:
            self._can.flush()         # first, so that a tick on disk has its frames there too
        finally:
            self._telemetry.flush()

    def write_trial(self, row: bytes, written: threading.Event) -> None:
        self._trials.write(row + b"\n")
        try:
            self._trials.flush()
        finally:
            written.set()

    def flush_trials(self) -> None:
        self._trials.flush()

    def sync_trials(self) -> None:
        self._trials.sync()

    def sync(self) -> None:
        for file in (self._trials, self._telemetry.file, self._can):
            file.sync()

    def write_picture(self, picture: CameraFrame) -> None:
        name = f"{picture.t_ns // 1_000_000:09d}.png"
        done, png = cv2.imencode(".png", picture.image, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        if not done:
            raise OSError(f"{name}: the image cannot be encoded")
        (self._folder / FRAMES / name).write_bytes(png.tobytes())
        self._index.write(msgspec.json.encode(Picture(picture.t_ns, name)) + b"\n")
        self._index.flush()

    def write_lateness(self, row: bytes) -> None:
        with (self._folder / LATENESS).open("ab") as file:
            file.write(row + b"\n")

    def finish(self) -> None:
        self._telemetry.finish()

    def close(self) -> None:
        files = (self._telemetry.file, self._can, self._trials, self._index)
        try:
            for file in files:
                file.flush()
                file.sync()
        finally:
            for file in files:
                file.close()


def _make_folder(folder: Path, header: Header, config: Config, model: bytes | None) -> None:
    if folder.exists():
        raise BadInput(f"{folder}: exists already; a recording is never written over")
    (folder / FRAMES).mkdir(parents=True)
    _save(folder / CONFIG, msgspec.json.format(msgspec.json.encode(config)) + b"\n")
    if model is not None:
        _save(folder / MODEL, model)
    _save(folder / HEADER, msgspec.json.format(msgspec.json.encode(header)) + b"\n")


def _save(path: Path, data: bytes) -> None:
    try:
        with path.open("xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise BadInput(f"{path}: {in_words(error)}") from error
