"""Writes a session. The tick only encodes and enqueues; one thread owns the files."""

import os
import queue
import threading
from pathlib import Path
from typing import IO

import cv2
import msgspec
from mcap.writer import CompressionType, Writer

from hw.link import Frame
from hw.reading import CameraFrame
from robot.config import BadInput, Config
from robot.lateness import Second
from robot.recording.candump import candump_line
from robot.recording.session import (
    CAN,
    CONFIG,
    FRAMES,
    HEADER,
    LATENESS,
    MODEL,
    TELEMETRY,
    TRIALS,
    Header,
    Trial,
)
from robot.types import Sent, Tick

BATCH_TICKS = 25                      # handed to the thread together: a wake-up a tick would cost the loop its rhythm
QUEUE_ITEMS = 800                     # batches: more than a minute and a half
Row = tuple[int, bytes, list[tuple[Frame, bool]]]     # t_ns, the encoded Tick, raw frames of the tick


class SessionWriter:
    """A Recorder that keeps everything in a folder made for it.

    `lossless`: a full queue makes the caller wait instead of dropping; for the twin, whose time can wait.
    """

    def __init__(self, folder: Path, header: Header, config: Config, model: bytes | None, lossless: bool) -> None:
        if folder.exists():
            raise BadInput(f"{folder}: exists already; a recording is never written over")
        folder.mkdir(parents=True)
        (folder / FRAMES).mkdir()
        (folder / HEADER).write_bytes(msgspec.json.format(msgspec.json.encode(header)) + b"\n")
        (folder / CONFIG).write_bytes(msgspec.json.format(msgspec.json.encode(config)) + b"\n")
        if model is not None:
            (folder / MODEL).write_bytes(model)
        self.dropped = 0
        self.failed: OSError | None = None
        self._lossless = lossless
        self._encoder = msgspec.json.Encoder()
        self._frames: list[tuple[Frame, bool]] = []
        self._rows: list[Row] = []
        self._queue: queue.Queue[tuple[str, object] | None] = queue.Queue(QUEUE_ITEMS)
        self._thread = threading.Thread(target=self._work, args=(folder,), name="recorder", daemon=True)
        self._thread.start()

    def tap(self, frame: Frame, sent: bool) -> None:
        """Keep one raw CAN frame; `sent` tells ours from the devices'."""
        self._frames.append((frame, sent))

    def record(self, tick: Tick, sent: Sent) -> None:
        row = self._encoder.encode(msgspec.structs.replace(tick, sent=sent))
        frames, self._frames = self._frames, []
        self._rows.append((tick.inputs.t_ns, row, frames))
        if len(self._rows) >= BATCH_TICKS:
            self._put_rows()
        for outcome in tick.outcomes:
            shot = tick.memory.last_shot
            mine = shot if shot is not None and shot.trial == outcome.trial else None
            self._put(("trial", self._encoder.encode(Trial(outcome, mine))))

    def keep_picture(self, picture: CameraFrame) -> None:
        self._put(("picture", picture))

    def keep_lateness(self, second: Second) -> None:
        self._put(("lateness", self._encoder.encode(second)))

    def close(self) -> None:
        """Write out what is queued and close the files."""
        self._put_rows()
        self._queue.put(None)
        self._thread.join()

    def _put_rows(self) -> None:
        rows, self._rows = self._rows, []
        self._put(("ticks", rows))

    def _put(self, item: tuple[str, object]) -> None:
        if self._lossless:
            self._queue.put(item)
            return
        try:
            self._queue.put_nowait(item)
        except queue.Full:
            self.dropped += 1

    def _work(self, folder: Path) -> None:
        try:
            with _Files(folder) as files:
                while (item := self._queue.get()) is not None:
                    files.write(*item)
        except OSError as error:      # a full or read-only disk must not stop the robot; the door reports it
            self.failed = error
            while self._queue.get() is not None:
                self.dropped += 1


class _Files:
    """The open files of a session, used by the recorder's thread alone."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._telemetry: IO[bytes] = (folder / TELEMETRY).open("wb")
        self._can: IO[str] = (folder / CAN).open("w", encoding="ascii", newline="\n")
        self._trials: IO[bytes] = (folder / TRIALS).open("wb")
        self._mcap = Writer(self._telemetry, compression=CompressionType.ZSTD)
        self._mcap.start(profile="", library="truearc")
        schema = msgspec.json.encode(msgspec.json.schema(Tick))
        schema_id = self._mcap.register_schema("truearc.Tick", "jsonschema", schema)
        self._channel = self._mcap.register_channel("/tick", "json", schema_id)
        self._ticks = 0

    def __enter__(self) -> "_Files":
        return self

    def __exit__(self, *_: object) -> None:
        self._mcap.finish()
        for file in (self._telemetry, self._can, self._trials):
            file.close()

    def write(self, kind: str, item: object) -> None:
        getattr(self, "_write_" + kind)(item)

    def _write_ticks(self, rows: list[Row]) -> None:
        for t_ns, row, frames in rows:
            self._mcap.add_message(self._channel, log_time=t_ns, data=row, publish_time=t_ns, sequence=self._ticks)
            if frames:
                self._can.write("".join([candump_line(frame, sent, t_ns) for frame, sent in frames]))
            self._ticks += 1
        self._mcap.flush()            # closes the chunk: a killed recorder loses one batch, an eighth of a second
        self._telemetry.flush()
        self._can.flush()

    def _write_trial(self, row: bytes) -> None:
        self._trials.write(row + b"\n")
        self._trials.flush()
        os.fsync(self._trials.fileno())

    def _write_picture(self, picture: CameraFrame) -> None:
        name = f"{picture.t_ns // 1_000_000:09d}.png"
        cv2.imwrite(str(self._folder / FRAMES / name), picture.image, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        with (self._folder / FRAMES / "frames.jsonl").open("ab") as index:
            index.write(msgspec.json.encode({"t_ns": picture.t_ns, "file": name}) + b"\n")

    def _write_lateness(self, row: bytes) -> None:
        with (self._folder / LATENESS).open("ab") as file:
            file.write(row + b"\n")
