"""Writes a session. The tick only encodes and hands over; a keeper owns the files, in this process or in another."""

from collections.abc import Callable, Mapping
from pathlib import Path

import msgspec

from truearc.errors import InputError, in_words
from truearc.hw.protocols import CameraFrame, Frame
from truearc.hw.reason import Reason
from truearc.robot.config.schema import Config
from truearc.robot.processes.tick_timing import Second
from truearc.robot.recording.file_writers import Keeper, LaneKeeper
from truearc.robot.recording.files import Row, session_contents
from truearc.robot.recording.session import Header, make_trials
from truearc.robot.types import Sent, Tick

BATCH_NS = 100_000_000                # handed over together: a wake-up a tick would cost the loop its rhythm
SYNC_NS = 1_000_000_000               # a power cut may cost this much
MARKING_NS = 30_000_000_000           # for a driver to mark the shot that is out, when nothing more is kept
OpenKeeper = Callable[[Path, Mapping[str, bytes]], Keeper]


class SessionWriter:
    """A Recorder that keeps everything in a folder made for it; InputError when that cannot be made.

    A process that is killed loses no tick older than a fifth of a second, and no trial: `record` returns when the
    system has its row, unless the disk stalls for longer than MARK_S. `lossless`: whatever the disk does, the caller
    waits and nothing is dropped; for the twin, whose time can wait. `trouble` is why ticks or trials are not reaching
    the disk; after `close`, `failed` is. `open_keeper`: who makes the folder with those files and keeps it there,
    if no threads of this process.
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
        self._encoder = msgspec.json.Encoder()
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
        """Whether nothing more will ever be kept, and the shot that is out has its mark, or is not going to have it."""
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
        trials = [self._encoder.encode(trial) for trial in make_trials(tick)]
        for trial in trials:
            self._keeper.keep_trial(trial)
        frames, self._frames = self._frames, []
        self._rows.append((t_ns, self._encoder.encode(msgspec.structs.replace(tick, sent=sent)), frames, trials))
        if t_ns - self._rows[0][0] >= BATCH_NS:
            self._hand_rows()
        if t_ns - self._synced_ns >= SYNC_NS:
            self._synced_ns = t_ns
            self._keeper.sync()
        self._keeper.push()

    def keep_picture(self, picture: CameraFrame) -> None:
        self._keeper.keep_picture(picture)

    def keep_lateness(self, second: Second) -> None:
        self._keeper.keep_lateness(self._encoder.encode(second))

    def close(self) -> None:
        """Write out what waits and close the files."""
        self._hand_rows()
        self._keeper.close()

    def _hand_rows(self) -> None:
        rows, self._rows = self._rows, []
        self._keeper.keep_rows(rows)
