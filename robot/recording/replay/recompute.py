"""Replay: recompute every output of a recording and compare to the last bit.

From the recorded inputs, or from deeper: the raw CAN frames and the kept images, parsed and seen again.
"""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from msgspec.structs import replace

from truearc.errors import InputError
from truearc.hw.protocols import CameraFrame
from truearc.robot.advice import POLICY as ADVICE
from truearc.robot.advice import step as advise
from truearc.robot.config.schema import Config
from truearc.robot.recording import session as layout
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.replay.frame_replay import FramesRig, Recomputed
from truearc.robot.rig import ReplayRig
from truearc.robot.runtime import RobotIo, run
from truearc.robot.sysid.tick import POLICY, make_step
from truearc.robot.tick import step
from truearc.robot.types import Sent, Tick


class Difference(Exception):
    """The first recomputed value that is not the recorded one; the message names tick and field."""


class Replayed(NamedTuple):
    """What came out bit-equal."""

    ticks: int
    cut_short: str | None             # what was wrong with the file's tail, if anything


class Comparer:
    """A Recorder that keeps nothing and compares everything."""

    def __init__(self, rows: "RecordedRows") -> None:
        self._rows = rows

    def record(self, tick: Tick, sent: Sent) -> None:
        again = self._rows.format.encode_tick(replace(tick, sent=sent))
        if again != self._rows.current:
            raise Difference(_first_difference(self._rows.current, again))

    def keep_picture(self, picture: CameraFrame) -> None: ...


class RecordedRows:
    """Feeds ticks to a ReplayRig while keeping the bytes of the current one.

    Difference where ticks were never recorded, for what follows cannot be recomputed from what came before.
    """

    def __init__(self, reader: TickReader) -> None:
        self._reader = reader
        self.format = reader.rows
        self.current = b""

    def __iter__(self) -> Iterator[Tick]:
        before = 0
        for tick, row in self._reader:
            cycle = tick.inputs.cycle
            if cycle != before + 1:
                raise Difference(f"cycle {cycle} follows {before}: the ticks between are not in the recording")
            self.current, before = row, cycle
            yield tick


def replay(session: Path) -> Replayed:
    """Recompute the outputs of every tick from its recorded inputs.

    Raises Difference at the first tick that does not match; InputError when there is nothing to match.
    """
    return _replay(session, lambda rows, config: ReplayRig(rows))


def replay_frames(session: Path) -> tuple[Replayed, Recomputed]:
    """As `replay`, with the inputs recomputed, too, from what can0.log and frames/ hold of them."""
    done = Recomputed()
    try:
        replayed = _replay(session, lambda rows, config: FramesRig(ReplayRig(rows), config, session, rows.format, done))
    except Difference as difference:
        if done.frames == 0:
            raise InputError(f"{session / layout.TELEMETRY}: does not say which frames each tick had read: recorded "
                             "before that was kept") from difference
        raise
    if done.frames == 0:
        raise InputError(f"{session}: no frames to parse again")
    return replayed._replace(cut_short=replayed.cut_short or done.ended or None), done


def _replay(session: Path, make_rig: Callable[[RecordedRows, Config], RobotIo]) -> Replayed:
    config, gate, reader = layout.load_session_config(session), layout.load_session_gate(session), TickReader(session)
    rows = RecordedRows(reader)
    aims = layout.load_session_aims(session)
    policy = layout.load_header(session).policy
    think = make_step(config) if policy == POLICY else partial(advise if policy == ADVICE else step, aims=aims)
    return matched(run(make_rig(rows, config), config, gate, Comparer(rows), think), reader)


def matched(ticks: int, reader: TickReader) -> Replayed:
    """Return what a replay of this number of ticks has shown; InputError when there were none."""
    if ticks == 0:
        raise InputError(f"{reader.path}: no ticks to replay" + (f" ({reader.cut_short})" if reader.cut_short else ""))
    return Replayed(ticks, reader.cut_short)


def _first_difference(was: bytes, now: bytes) -> str:
    old, new = msgspec.json.decode(was), msgspec.json.decode(now)
    path, before, after = next(find_differences(old, new, "tick."), ("tick", old, new))
    return f"cycle {old['inputs']['cycle']}: {path} was {before!r}, is now {after!r}"


def find_differences(was: Any, now: Any, prefix: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Dotted name, old and new value of each part that differs between two values of built-in types."""
    if isinstance(was, dict) and isinstance(now, dict):
        parts = [(key, was.get(key), now.get(key)) for key in dict.fromkeys([*was, *now])]
    elif isinstance(was, list | tuple) and isinstance(now, list | tuple) and len(was) == len(now):
        parts = list(zip(range(len(was)), was, now, strict=True))
    else:
        parts = []
        if was != now:
            yield prefix.removesuffix("."), was, now
    for key, one, other in parts:
        yield from find_differences(one, other, f"{prefix}{key}.")
