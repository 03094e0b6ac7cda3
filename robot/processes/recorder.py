"""The recorder in a process of its own: takes messages from the control loop, and hands what they hold to the files."""

import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import msgspec
import numpy as np
from msgspec import Struct

from truearc.errors import InputError, in_words
from truearc.hw.protocols import CameraFrame, Clock, LinkLost
from truearc.hw.reason import Reason
from truearc.hw.shared_latest import Capacity, Slots
from truearc.robot.reasons import text
from truearc.robot.recording.files import Row
from truearc.robot.recording.writer import LaneKeeper

SAY_S = 1.0                           # between lines on the console: what is refused now may be taken a moment later
LOOK_S = 0.1                          # it says this often, at least, that it is alive and how the files are
NEWS = Capacity(4, 4096)
LONGEST_WORDS = 1000
NS_PER_S = 1_000_000_000


class Open(Struct, frozen=True, tag="open"):
    """The first message: what to make, and the files that do not grow."""

    folder: str
    contents: dict[str, bytes]


class RecorderRows(Struct, frozen=True, tag="rows"):
    rows: list[Row]


class TrialRow(Struct, frozen=True, tag="trial"):
    row: bytes


class PictureRow(Struct, frozen=True, tag="picture"):
    t_ns: int
    height: int
    width: int
    pixels: memoryview


class LatenessRow(Struct, frozen=True, tag="lateness"):
    row: bytes


class Sync(Struct, frozen=True, tag="sync"):
    pass


class End(Struct, frozen=True, tag="end"):
    """The last message. Without it the control process has died, and what came before is kept all the same."""


Message = Open | RecorderRows | TrialRow | PictureRow | LatenessRow | Sync | End


class Status(Struct, frozen=True):
    """The recorder's state as reported to the control loop."""

    is_open: bool = False
    trials_kept: int = 0              # how many of those that were handed over the system has
    dropped: int = 0
    trouble: Reason | None = None
    is_done: bool = False             # the files are whole, as far as they could be written
    failed: str = ""                  # why not all was kept; the end


class Mail(Protocol):
    """Where messages come from."""

    def read(self, wait_s: float) -> list[bytes]: ...


class Desk:
    """Handles messages until the last one.

    `show` is handed the rows of ticks, ten times a second, after they went on their way to the files: the place for
    whoever shows them to people.
    """

    def __init__(self, slots: Slots, clock: Clock, show: Callable[[list[Row]], None],
                 began: Callable[[Path], None] = lambda folder: None) -> None:
        """`began`: called with the session's folder, once it is being recorded."""
        self._slots, self._clock, self._show, self._began = slots, clock, show, began
        self._decoder = msgspec.msgpack.Decoder(Message)
        self._keeper: LaneKeeper | None = None
        self._told = Status()
        self._said: Reason | None = None
        self._said_ns = 0
        self._is_over = False

    def serve(self, mail: Mail) -> None:
        """Handle messages until End, or until the sender is gone."""
        while not self._is_over:
            self._slots.beat(self._clock.now_ns())
            try:
                messages = mail.read(LOOK_S)
            except LinkLost:
                break
            for message in messages:
                self._handle(self._decoder.decode(message))
            self._tell(self._status())
            self._say(self._told.trouble)
        if self._keeper is not None:
            self._close(self._keeper)
            failed = "" if self._keeper.failed is None else in_words(self._keeper.failed)
            self._tell(msgspec.structs.replace(self._status(), is_done=True, failed=failed[:LONGEST_WORDS]))

    def _close(self, keeper: LaneKeeper) -> None:
        """However long that takes, it is said meanwhile that this process is alive."""
        closing = threading.Thread(target=keeper.close, name="closing", daemon=True)
        closing.start()
        while closing.is_alive():
            self._slots.beat(self._clock.now_ns())
            closing.join(LOOK_S)

    def _handle(self, message: Message) -> None:
        if isinstance(message, Open):
            return self._open(Path(message.folder), message.contents)
        if isinstance(message, End) or self._keeper is None:
            self._is_over = True
            return None
        match message:
            case RecorderRows(rows):
                self._keeper.keep_rows(rows)
                self._show(rows)
            case TrialRow(row):
                self._keeper.keep_trial(row)
                self._tell(self._status())        # at once: a tick waits for it
            case PictureRow(t_ns, height, width, pixels):
                image = np.frombuffer(pixels, dtype=np.uint8).reshape(height, width, 3)
                self._keeper.keep_picture(CameraFrame(t_ns, image))
            case LatenessRow(row):
                self._keeper.keep_lateness(row)
            case Sync():
                self._keeper.sync()
        return None

    def _open(self, folder: Path, contents: dict[str, bytes]) -> None:
        try:
            self._keeper = LaneKeeper(folder, contents, lossless=False, waits=True)
            self._began(folder)
        except (OSError, InputError) as error:
            where = f"{error.filename or folder}: {in_words(error)}" if isinstance(error, OSError) else str(error)
            self._tell(Status(failed=where))
            self._is_over = True

    def _status(self) -> Status:
        if self._keeper is None:
            return self._told
        return Status(True, self._keeper.trials_kept, self._keeper.dropped, self._keeper.trouble())

    def _say(self, trouble: Reason | None) -> None:
        """On the console, when that changes: a robot that holds its fire may have no page open."""
        now_ns = self._clock.now_ns()
        if trouble != self._said and now_ns - self._said_ns > SAY_S * NS_PER_S:
            self._said, self._said_ns = trouble, now_ns
            words = "recording again" if trouble is None else f"not recording: {text(trouble)}; holding fire"
            sys.stderr.write(f"truearc run: {words}\n")      # at one stroke: the control process writes there, too
            sys.stderr.flush()

    def _tell(self, status: Status) -> None:
        if status != self._told:
            self._told = status
            self._slots.put(msgspec.json.encode(status))
