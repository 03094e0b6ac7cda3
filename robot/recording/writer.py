"""The writer of a session, and the recorder that runs in its own process.

The tick only encodes messages; a keeper owns the files. LaneKeeper writes them in three threads of this process.
FarKeeper is the control loop's end of a recorder in a separate process, where `Desk` receives the messages and passes
their contents to a LaneKeeper.
"""

import errno
import queue
import sys
import threading
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import msgspec
import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from truearc.errors import InputError, in_words
from truearc.hw.protocols import NS_PER_S, CameraFrame, Clock, Frame, LinkLost
from truearc.hw.real.processes import Capacity, Child, Inbox, Outbox, Slots
from truearc.hw.reason import Reason
from truearc.robot import runtime, types
from truearc.robot.config.schema import Config
from truearc.robot.reasons import DISK_ERROR, DISK_FULL, DISK_UNRESPONSIVE, RECORDER_UNRESPONSIVE, text
from truearc.robot.recording.files import DISK_ERRNOS, NotKept, Row, SessionFiles, append_trials, session_contents
from truearc.robot.recording.session import Header, encode_row, make_trials

BATCH_NS = 100_000_000                # handed over together: a wake-up a tick would cost the loop its rhythm
SYNC_NS = 1_000_000_000               # a power cut may cost this much
MARKING_NS = 30_000_000_000           # for a driver to mark the shot that is out, when nothing more is kept
OpenKeeper = Callable[[Path, Mapping[str, bytes]], "Keeper"]
MARK_S = 0.01                         # a tick waits no longer for its trial to be written; usually under 1 ms
LONGEST_DETAIL = 1000                 # characters of an error's text
LONGEST = 1000                        # jobs that may wait; more than a minute and a half of ticks
SLOW_JOBS = 20                        # two seconds of batches wait: the disk does not answer
Job = Callable[[], None]


class SessionWriter:
    """A Recorder that keeps everything in a folder made for it; InputError when that cannot be made.

    A process that is killed loses no tick older than a fifth of a second, and no trial: `record` returns when the
    system has its row, unless the disk stalls for longer than MARK_S. `lossless`: the caller always waits for the disk
    and nothing is dropped; for the twin, whose time can wait. `trouble` is why ticks or trials are not reaching the
    disk; after `close`, `failed` is. `open_keeper`: makes the folder with those files and keeps it; by default, threads
    of this process do.
    """

    def __init__(self, folder: Path, header: Header, config: Config, model: bytes | None, lossless: bool,
                 open_keeper: OpenKeeper | None = None, aim: bytes | None = None) -> None:
        self.folder = folder
        contents = session_contents(header, config, model, aim)
        try:
            self._keeper = (LaneKeeper(folder, contents, lossless) if open_keeper is None
                            else open_keeper(folder, contents))
        except OSError as error:
            raise InputError(f"{error.filename or folder}: {in_words(error)}") from error
        self._frames: list[tuple[Frame, bool]] = []
        self._rows: list[Row] = []
        self._synced_ns = 0
        self._is_out = False              # a shot is being fed, or has no mark yet
        self._t_ns, self._gone_ns = 0, 0

    @property
    def dropped(self) -> int:
        """Batches, trials and pictures lost because the disk was too slow."""
        return self._keeper.dropped

    @property
    def failed(self) -> Exception | None:
        return self._keeper.failed

    def trouble(self) -> Reason | None:
        """Why recorded data are not reaching the disk; None while they are."""
        return self._keeper.trouble()

    def is_over(self) -> bool:
        """Whether recording has ended for good and the last shot is marked, or its time for marking is over."""
        if not self._keeper.is_gone():
            return False
        self._gone_ns = self._gone_ns or self._t_ns
        return not self._is_out or self._t_ns - self._gone_ns >= MARKING_NS

    def tap(self, frame: Frame, sent: bool) -> None:
        """Keep one raw CAN frame; `sent` distinguishes ours from the devices'."""
        self._frames.append((frame, sent))

    def record(self, tick: types.Tick, sent: types.Sent) -> None:
        self._t_ns = t_ns = tick.inputs.t_ns
        self._is_out = tick.memory.awaiting or tick.memory.feed_t_ns != 0
        trials = list(map(encode_row, make_trials(tick)))
        for trial in trials:
            self._keeper.keep_trial(trial)
        frames, self._frames = self._frames, []
        self._rows.append((t_ns, encode_row(replace(tick, sent=sent)), frames, trials))
        if t_ns - self._rows[0][0] >= BATCH_NS:
            self._hand_rows()
        if t_ns - self._synced_ns >= SYNC_NS:
            self._synced_ns = t_ns
            self._keeper.sync()
        self._keeper.push()

    def keep_picture(self, picture: CameraFrame) -> None:
        self._keeper.keep_picture(picture)

    def keep_lateness(self, second: runtime.Second) -> None:
        self._keeper.keep_lateness(encode_row(second))

    def close(self) -> None:
        """Write out pending data and close the files."""
        self._hand_rows()
        self._keeper.close()

    def _hand_rows(self) -> None:
        rows, self._rows = self._rows, []
        self._keeper.keep_rows(rows)


class Lane:
    """One thread that does its jobs in order.

    `trouble` is the error of the newest job, None if it succeeded. `patient`: the caller waits until all earlier jobs
    are done, instead of losing a job (`dropped`) when too many wait; for the twin, whose time can wait.
    """

    def __init__(self, name: str, patient: bool, longest: int = LONGEST) -> None:
        self.dropped = 0
        self.trouble: Exception | None = None
        self._patient = patient
        self._jobs: queue.Queue[Job | None] = queue.Queue(longest)
        self._thread = threading.Thread(target=self._work, name=f"recorder {name}", daemon=True)
        self._thread.start()

    def hand(self, job: Job) -> None:
        if self._patient:
            self._jobs.join()
        try:
            self._jobs.put_nowait(job)
        except queue.Full:
            self.dropped += 1

    def waiting(self) -> int:
        """Number of jobs that have not been started."""
        return self._jobs.qsize()

    def close(self) -> None:
        """Do the pending jobs, and end."""
        self._jobs.put(None)
        self._thread.join()

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            try:
                job()
                self.trouble = None
            except Exception as error:    # of any kind: the robot runs on, and holds fire while this lasts
                self.trouble = error
            finally:
                self._jobs.task_done()


class LaneKeeper:
    """A Keeper that writes the files of `folder` in three threads. It takes encoded rows; no method waits for a disk.

    Ticks and CAN frames are handed to the system as they come, trials at once. Pictures and every fsync, which may take
    long, have a thread to themselves, so that neither of the others waits for it. `lossless`: the caller always waits
    for the disk and nothing is dropped. `waits`: a disk without room for the folder is trouble, not an error
    (SessionFiles). `longest`: jobs that may wait for each thread.
    """

    def __init__(self, folder: Path, contents: Mapping[str, bytes], lossless: bool, waits: bool = False,
                 longest: int = LONGEST) -> None:
        self.failed: Exception | None = None      # after `close`: why not all has been kept
        self._lossless = lossless
        self._files = SessionFiles(folder, contents, waits)
        self._ticks, self._trials, self._slow = (Lane(name, lossless, longest)
                                                  for name in ("ticks", "trials", "pictures"))
        self._lanes = (self._ticks, self._trials, self._slow)

    @property
    def dropped(self) -> int:
        """Batches, trials and pictures that are lost for good."""
        return sum(lane.dropped for lane in self._lanes)

    @property
    def trials_kept(self) -> int:
        """How many of the submitted trials the system has."""
        return self._files.trials_kept

    def keep_rows(self, rows: list[Row]) -> None:
        self._ticks.hand(partial(self._files.write_ticks, rows))

    def keep_trial(self, row: bytes) -> None:
        """Return when the system has the row, or after MARK_S."""
        written = threading.Event()
        self._trials.hand(partial(self._files.write_trial, row, written))
        written.wait(None if self._lossless else MARK_S)
        self._slow.hand(self._files.sync_trials)

    def keep_picture(self, picture: CameraFrame) -> None:
        self._slow.hand(partial(self._files.write_picture, picture))

    def keep_lateness(self, row: bytes) -> None:
        self._slow.hand(partial(self._files.write_lateness, row))

    def sync(self) -> None:
        """Make what was kept survive a power cut soon."""
        self._trials.hand(self._files.flush_trials)
        self._slow.hand(self._files.sync)

    def push(self) -> None:
        """Continue pending work; called once per tick."""

    def trouble(self) -> Reason | None:
        """Why recorded data are not reaching the disk; None while they are."""
        troubles = (self._files.unmade, *(lane.trouble for lane in self._lanes))
        if (error := next(filter(None, troubles), None)) is not None:
            return disk_trouble(error)
        return DISK_UNRESPONSIVE() if max(lane.waiting() for lane in self._lanes) > SLOW_JOBS else None

    def is_gone(self) -> bool:
        """Whether nothing more will ever be kept."""
        return False

    def close(self) -> None:
        """Write out pending data and close the files."""
        self._ticks.hand(self._files.finish)
        for lane in self._lanes:
            lane.close()
        troubles = [lane.trouble for lane in self._lanes if lane.trouble is not None]
        try:
            self._files.close()       # which writes what a full disk has not taken before
            troubles = [error for error in troubles if getattr(error, "errno", None) not in DISK_ERRNOS]
        except OSError as error:
            troubles.append(error)
        self.failed = troubles[0] if troubles else None


def disk_trouble(error: Exception) -> Reason:
    """Return the reason for a write error."""
    if isinstance(error, NotKept):
        return error.reason
    if isinstance(error, OSError) and error.errno == errno.ENOSPC:
        return DISK_FULL()
    return DISK_ERROR(detail=in_words(error)[:LONGEST_DETAIL])


# --- a recorder in a process of its own

SAY_S = 1.0                           # between lines on the console: what is refused now may be taken a moment later
LOOK_S = 0.1                          # it says this often, at least, that it is alive and how the files are
NEWS = Capacity(4, 4096)
LONGEST_WORDS = 1000
SILENT_S = 1.5                        # a recorder that has not stirred for so long does not answer
LOOK_NS = 200_000                     # between looks at whether a trial has been kept
OPEN_S = 30.0                         # for files to be opened
CLOSE_S, LONGEST_S = 10.0, 60.0       # for all that waits to be written: since the recorder stirred last, and in all
PENDING_BYTES = 64 << 20              # for a recorder that takes nothing: over two minutes of ticks


class Message(Struct, frozen=True, omit_defaults=True):
    """A request to the recorder: a method of its keeper and its arguments; or "open", which comes first, or "end".

    Without an "end" the control process has died, and everything received before is still kept.
    """

    do: str
    folder: str = ""
    contents: dict[str, bytes] = {}   # of "open": the files that do not grow
    rows: list[Row] = []
    row: bytes = b""
    t_ns: int = 0                     # of a picture
    shape: tuple[int, int] = (0, 0)   # height, width
    pixels: memoryview | None = None


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

    `show` receives the rows of ticks ten times a second, after they were passed to the files, for display.
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
        """Handle messages until the end, or until the sender is gone."""
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
        if message.do == "open":
            self._open(Path(message.folder), message.contents)
        elif message.do == "end" or self._keeper is None:
            self._is_over = True
        elif message.do == "keep_rows":
            self._keeper.keep_rows(message.rows)
            self._show(message.rows)
        elif message.do == "keep_trial":
            self._keeper.keep_trial(message.row)
            self._tell(self._status())            # at once: a tick waits for it
        elif message.pixels is not None:
            image = np.frombuffer(message.pixels, dtype=np.uint8).reshape(*message.shape, 3)
            self._keeper.keep_picture(CameraFrame(message.t_ns, image))
        elif message.do == "keep_lateness":
            self._keeper.keep_lateness(message.row)
        else:
            self._keeper.sync()

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
        self._send(Message("open", str(folder), dict(contents)))
        self._wait(OPEN_S, lambda: self._status().is_open or bool(self._newest.failed))
        if not self._newest.is_open:
            raise InputError(self._newest.failed or text(self._process.trouble or RECORDER_UNRESPONSIVE()))

    @property
    def dropped(self) -> int:
        return self._lost + self._status().dropped

    def keep_rows(self, rows: list[Row]) -> None:
        self._send_if_room(Message("keep_rows", rows=rows))

    def keep_trial(self, row: bytes) -> None:
        self._trials.append(row)
        self._send(Message("keep_trial", row=row))
        self._wait(MARK_S, lambda: not self._unkept())

    def keep_picture(self, picture: CameraFrame) -> None:
        height, width, _ = picture.image.shape
        pixels = np.ascontiguousarray(picture.image).reshape(-1).data
        self._send_if_room(Message("keep_picture", t_ns=picture.t_ns, shape=(height, width), pixels=pixels))

    def keep_lateness(self, row: bytes) -> None:
        self._send_if_room(Message("keep_lateness", row=row))

    def sync(self) -> None:
        self._send_if_room(Message("sync"))

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
        self._send(Message("end"))
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


Keeper = LaneKeeper | FarKeeper
