"""Writer of a session. The tick only encodes and hands over; a keeper owns the files.

LaneKeeper keeps them in three threads of this process; truearc.robot.recording.recorder in another process.
"""

import errno
import queue
import threading
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Protocol

from msgspec.structs import replace

from truearc.errors import InputError, in_words
from truearc.hw.protocols import CameraFrame, Frame
from truearc.hw.reason import Reason
from truearc.robot.config.schema import Config
from truearc.robot.reasons import DISK_ERROR, DISK_FULL, DISK_UNRESPONSIVE
from truearc.robot.recording.files import DISK_ERRNOS, NotKept, Row, SessionFiles, session_contents
from truearc.robot.recording.session import Header, encode_row, make_trials
from truearc.robot.runtime import Second
from truearc.robot.types import Sent, Tick

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
        """Why what is recorded is not reaching the disk; None while it is."""
        return self._keeper.trouble()

    def is_over(self) -> bool:
        """Whether recording has ended for good, and the last shot is marked or its time for marking is over."""
        if not self._keeper.is_gone():
            return False
        self._gone_ns = self._gone_ns or self._t_ns
        return not self._is_out or self._t_ns - self._gone_ns >= MARKING_NS

    def tap(self, frame: Frame, sent: bool) -> None:
        """Keep one raw CAN frame; `sent` tells ours from the devices'."""
        self._frames.append((frame, sent))

    def record(self, tick: Tick, sent: Sent) -> None:
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

    def keep_lateness(self, second: Second) -> None:
        self._keeper.keep_lateness(encode_row(second))

    def close(self) -> None:
        """Write out what waits and close the files."""
        self._hand_rows()
        self._keeper.close()

    def _hand_rows(self) -> None:
        rows, self._rows = self._rows, []
        self._keeper.keep_rows(rows)


class Lane:
    """One thread that does what it is handed, in order.

    `trouble` is what the newest job met, None when it went well. `patient`: the caller waits until all earlier jobs
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
        """Do what waits, and end."""
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


class Keeper(Protocol):
    """Takes encoded rows, in this process or on their way to another. No method waits for a disk."""

    failed: Exception | None          # after `close`: why not all has been kept

    @property
    def dropped(self) -> int:
        """Batches, trials and pictures that are lost for good."""

    def keep_rows(self, rows: list[Row]) -> None: ...

    def keep_trial(self, row: bytes) -> None:
        """Returns when the system has the row, or after MARK_S."""

    def keep_picture(self, picture: CameraFrame) -> None: ...

    def keep_lateness(self, row: bytes) -> None: ...

    def sync(self) -> None:
        """Have what was kept survive a power cut, soon."""

    def push(self) -> None:
        """Continue what is waiting; called once per tick."""

    def trouble(self) -> Reason | None:
        """Why what is recorded is not reaching the disk; None while it is."""

    def is_gone(self) -> bool:
        """Whether nothing more will ever be kept."""

    def close(self) -> None:
        """Write out what waits and close the files."""


class LaneKeeper:
    """A Keeper that writes the files of `folder` in three threads.

    Ticks and CAN frames are handed to the system as they come, trials at once. Pictures and every fsync, which may take
    long, have a thread to themselves, so that neither of the others waits for it. `lossless`: the caller always waits
    for the disk and nothing is dropped. `waits`: a disk without room for the folder is trouble, not an error
    (SessionFiles). `longest`: jobs that may wait for each thread.
    """

    def __init__(self, folder: Path, contents: Mapping[str, bytes], lossless: bool, waits: bool = False,
                 longest: int = LONGEST) -> None:
        self.failed: Exception | None = None
        self._lossless = lossless
        self._files = SessionFiles(folder, contents, waits)
        self._ticks, self._trials, self._slow = (Lane(name, lossless, longest)
                                                  for name in ("ticks", "trials", "pictures"))
        self._lanes = (self._ticks, self._trials, self._slow)

    @property
    def dropped(self) -> int:
        return sum(lane.dropped for lane in self._lanes)

    @property
    def trials_kept(self) -> int:
        """How many of the trials that were handed over the system has."""
        return self._files.trials_kept

    def keep_rows(self, rows: list[Row]) -> None:
        self._ticks.hand(partial(self._files.write_ticks, rows))

    def keep_trial(self, row: bytes) -> None:
        written = threading.Event()
        self._trials.hand(partial(self._files.write_trial, row, written))
        written.wait(None if self._lossless else MARK_S)
        self._slow.hand(self._files.sync_trials)

    def keep_picture(self, picture: CameraFrame) -> None:
        self._slow.hand(partial(self._files.write_picture, picture))

    def keep_lateness(self, row: bytes) -> None:
        self._slow.hand(partial(self._files.write_lateness, row))

    def sync(self) -> None:
        self._trials.hand(self._files.flush_trials)
        self._slow.hand(self._files.sync)

    def push(self) -> None: ...

    def trouble(self) -> Reason | None:
        troubles = (self._files.unmade, *(lane.trouble for lane in self._lanes))
        if (error := next(filter(None, troubles), None)) is not None:
            return disk_trouble(error)
        return DISK_UNRESPONSIVE() if max(lane.waiting() for lane in self._lanes) > SLOW_JOBS else None

    def is_gone(self) -> bool:
        return False

    def close(self) -> None:
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
    """The reason that an error of writing stands for."""
    if isinstance(error, NotKept):
        return error.reason
    if isinstance(error, OSError) and error.errno == errno.ENOSPC:
        return DISK_FULL()
    return DISK_ERROR(detail=in_words(error)[:LONGEST_DETAIL])
