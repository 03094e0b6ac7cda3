"""The control process's end of the recorder: truearc.robot.recording.writer.Keeper on files that another
process owns."""

from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Protocol

import msgspec
import numpy as np

from truearc.errors import InputError, in_words
from truearc.hw.protocols import CameraFrame, Clock
from truearc.hw.reason import Reason
from truearc.hw.shared_latest import Slots
from truearc.robot.processes import recorder
from truearc.robot.processes.recorder import Message, Status
from truearc.robot.reasons import RECORDER_UNRESPONSIVE, text
from truearc.robot.recording.files import Row, append_trials
from truearc.robot.recording.writer import MARK_S

NS_PER_S = 1_000_000_000
SILENT_S = 1.5                        # a recorder that has not stirred for so long does not answer
LOOK_NS = 200_000                     # between looks at whether a trial has been kept
OPEN_S = 30.0                         # for files to be opened
CLOSE_S, LONGEST_S = 10.0, 60.0       # for all that waits to be written: since the recorder stirred last, and in all
PENDING_BYTES = 64 << 20              # for a recorder that takes nothing: over two minutes of ticks


class Sender(Protocol):
    """Sends without waiting; `waiting`: bytes that have not gone out."""

    waiting: int

    def put(self, message: bytes) -> None: ...

    def push(self) -> None: ...


class Process(Protocol):
    """The recorder's process; `trouble` is why it does not work, None while it does."""

    trouble: Reason | None

    def is_gone(self) -> bool: ...

    def close(self, patience_s: float) -> None: ...


class FarKeeper:
    """Sends everything on, and keeps trials until the recorder reports that the system has their rows.

    Those that the recorder never came to it appends to the recording itself, when it is closed.
    """

    def __init__(self, folder: Path, contents: Mapping[str, bytes], sender: Sender, slots: Slots, process: Process,
                 clock: Clock) -> None:
        """InputError when the folder with these contents cannot be made there, whatever the disk."""
        self.failed: Exception | None = None
        self._folder, self._sender, self._slots, self._process, self._clock = folder, sender, slots, process, clock
        self._encoder, self._decoder = msgspec.msgpack.Encoder(), msgspec.json.Decoder(Status)
        self._newest = Status()
        self._lost = 0
        self._trials: deque[bytes] = deque()      # not reported as kept
        self._trials_kept = 0
        self._send(recorder.Open(str(folder), dict(contents)))
        self._wait(OPEN_S, lambda: self._status().is_open or bool(self._newest.failed))
        if not self._newest.is_open:
            raise InputError(self._newest.failed or text(self._process.trouble or RECORDER_UNRESPONSIVE()))

    @property
    def dropped(self) -> int:
        return self._lost + self._status().dropped

    def keep_rows(self, rows: list[Row]) -> None:
        self._send_if_room(recorder.RecorderRows(rows))

    def keep_trial(self, row: bytes) -> None:
        self._trials.append(row)
        self._send(recorder.TrialRow(row))
        self._wait(MARK_S, lambda: not self._unkept())

    def keep_picture(self, picture: CameraFrame) -> None:
        height, width, _ = picture.image.shape
        pixels = np.ascontiguousarray(picture.image).reshape(-1).data
        self._send_if_room(recorder.PictureRow(picture.t_ns, height, width, pixels))

    def keep_lateness(self, row: bytes) -> None:
        self._send_if_room(recorder.LatenessRow(row))

    def sync(self) -> None:
        self._send_if_room(recorder.Sync())

    def push(self) -> None:
        self._sender.push()
        self._unkept()

    def trouble(self) -> Reason | None:
        if self._process.trouble is not None:
            return self._process.trouble
        if self._silent_s() > SILENT_S:
            return RECORDER_UNRESPONSIVE()
        return self._status().trouble

    def is_gone(self) -> bool:
        return self._process.is_gone()

    def close(self) -> None:
        self._send(recorder.End())
        self._wait(LONGEST_S, lambda: self._status().is_done or self._silent_s() > CLOSE_S)
        words = self._newest.failed if self._newest.is_done else text(self.trouble() or RECORDER_UNRESPONSIVE())
        self._process.close(CLOSE_S if self._newest.is_done else 0.0)     # from here on no process has the files open
        try:
            if rows := self._unkept():
                append_trials(self._folder, list(rows))
        except OSError as error:
            words = f"{words}; {len(rows)} marked trials are lost: {in_words(error)}"
        self.failed = OSError(words) if words else None

    def _silent_s(self) -> float:
        return (self._clock.now_ns() - self._slots.beaten_ns()) / NS_PER_S

    def _send(self, message: Message) -> None:
        self._sender.put(self._encoder.encode(message))

    def _send_if_room(self, message: Message) -> None:
        if self._process.trouble or self._sender.waiting > PENDING_BYTES:
            self._lost += 1
        else:
            self._send(message)

    def _status(self) -> Status:
        text = self._slots.read()
        if text is not None:
            self._newest = self._decoder.decode(text)
        return self._newest

    def _unkept(self) -> deque[bytes]:
        """Trials that the recorder has not reported as kept yet."""
        kept = self._status().trials_kept
        while self._trials and self._trials_kept < kept:
            self._trials.popleft()
            self._trials_kept += 1
        return self._trials

    def _wait(self, limit_s: float, true: Callable[[], bool]) -> None:
        """Until it is as asked, or the process has ended, or for so long."""
        end_ns = self._clock.now_ns() + round(limit_s * NS_PER_S)
        while not true() and not self._process.trouble and (now_ns := self._clock.now_ns()) < end_ns:
            self._sender.push()
            self._clock.sleep_until_ns(now_ns + LOOK_NS)
