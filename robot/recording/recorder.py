"""The recorder in a process of its own, and FarKeeper, the control loop's end of it.

`Desk` takes messages from the control loop and passes their contents to the files. FarKeeper is a
truearc.robot.recording.writer.Keeper for files that another process owns.
"""

import sys
import threading
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path

import msgspec
import numpy as np
from msgspec import Struct

from truearc.errors import InputError, in_words
from truearc.hw.protocols import NS_PER_S, CameraFrame, Clock, LinkLost
from truearc.hw.real.processes import Capacity, Child, Inbox, Outbox, Slots
from truearc.hw.reason import Reason
from truearc.robot.reasons import RECORDER_UNRESPONSIVE, text
from truearc.robot.recording.files import Row, append_trials
from truearc.robot.recording.writer import MARK_S, LaneKeeper

SAY_S = 1.0                           # between lines on the console: what is refused now may be taken a moment later
LOOK_S = 0.1                          # it says this often, at least, that it is alive and how the files are
NEWS = Capacity(4, 4096)
LONGEST_WORDS = 1000
SILENT_S = 1.5                        # a recorder that has not stirred for so long does not answer
LOOK_NS = 200_000                     # between looks at whether a trial has been kept
OPEN_S = 30.0                         # for files to be opened
CLOSE_S, LONGEST_S = 10.0, 60.0       # for all that waits to be written: since the recorder stirred last, and in all
PENDING_BYTES = 64 << 20              # for a recorder that takes nothing: over two minutes of ticks


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

    def serve(self, mail: Inbox) -> None:
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
        """Close the keeper, and report meanwhile that this process is alive."""
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
        """Print a change of trouble on the console: a robot that holds fire may have no page open."""
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


class FarKeeper:
    """Forwards everything, and keeps trials until the recorder reports that the system has their rows.

    On `close` it appends to the recording the trials that the recorder never reached.
    """

    def __init__(self, folder: Path, contents: Mapping[str, bytes], sender: Outbox, slots: Slots, process: Child,
                 clock: Clock) -> None:
        """Raise InputError when the folder cannot be made, for any other reason than a full disk."""
        self.failed: Exception | None = None
        self._folder, self._sender, self._slots, self._process, self._clock = folder, sender, slots, process, clock
        self._encoder, self._decoder = msgspec.msgpack.Encoder(), msgspec.json.Decoder(Status)
        self._newest = Status()
        self._lost = 0
        self._trials: deque[bytes] = deque()      # not reported as kept
        self._trials_kept = 0
        self._send(Open(str(folder), dict(contents)))
        self._wait(OPEN_S, lambda: self._status().is_open or bool(self._newest.failed))
        if not self._newest.is_open:
            raise InputError(self._newest.failed or text(self._process.trouble or RECORDER_UNRESPONSIVE()))

    @property
    def dropped(self) -> int:
        return self._lost + self._status().dropped

    def keep_rows(self, rows: list[Row]) -> None:
        self._send_if_room(RecorderRows(rows))

    def keep_trial(self, row: bytes) -> None:
        self._trials.append(row)
        self._send(TrialRow(row))
        self._wait(MARK_S, lambda: not self._unkept())

    def keep_picture(self, picture: CameraFrame) -> None:
        height, width, _ = picture.image.shape
        pixels = np.ascontiguousarray(picture.image).reshape(-1).data
        self._send_if_room(PictureRow(picture.t_ns, height, width, pixels))

    def keep_lateness(self, row: bytes) -> None:
        self._send_if_room(LatenessRow(row))

    def sync(self) -> None:
        self._send_if_room(Sync())

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
        self._send(End())
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
        """Wait until the condition is true, the process has ended, or the time is over."""
        end_ns = self._clock.now_ns() + round(limit_s * NS_PER_S)
        while not true() and not self._process.trouble and (now_ns := self._clock.now_ns()) < end_ns:
            self._sender.push()
            self._clock.sleep_until_ns(now_ns + LOOK_NS)
