"""Replay: recompute every output from the recorded inputs and compare to the last bit."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec

from hw.reading import CameraFrame
from robot.config import BadInput
from robot.identify.tick import POLICY, make_step
from robot.recording.reader import TickReader
from robot.recording.session import load_header, load_session_config, load_session_gate
from robot.rig import ReplayRig
from robot.runtime import run
from robot.tick import step
from robot.types import Sent, Tick


class Difference(Exception):
    """The first recomputed value that is not the recorded one; the message names tick and field."""


class Comparer:
    """A Recorder that keeps nothing and compares everything."""

    def __init__(self, rows: "RecordedRows") -> None:
        self._rows = rows
        self._encoder = msgspec.json.Encoder()

    def record(self, tick: Tick, sent: Sent) -> None:
        again = self._encoder.encode(msgspec.structs.replace(tick, sent=sent))
        if again != self._rows.current:
            raise Difference(_first_difference(self._rows.current, again))

    def keep_picture(self, picture: CameraFrame) -> None: ...


class RecordedRows:
    """Feeds ticks to a ReplayRig while keeping the bytes of the current one."""

    def __init__(self, reader: TickReader) -> None:
        self._reader = reader
        self.current = b""

    def __iter__(self) -> Iterator[Tick]:
        for tick, row in self._reader:
            self.current = row
            yield tick


def replay(session: Path) -> tuple[int, str | None]:
    """Number of ticks that came out bit-equal, and what was wrong with the file's tail, if anything.

    Raises Difference at the first tick that does not match; BadInput when there is nothing to match.
    """
    config, gate = load_session_config(session), load_session_gate(session)
    reader = TickReader(session)
    rows = RecordedRows(reader)
    think = make_step(config) if load_header(session).policy == POLICY else step
    ticks = run(ReplayRig(rows), config, gate, Comparer(rows), think)
    if ticks == 0:
        raise BadInput(f"{reader.path}: no ticks to replay" + (f" ({reader.cut_short})" if reader.cut_short else ""))
    return ticks, reader.cut_short


def _first_difference(was: bytes, now: bytes) -> str:
    old, new = msgspec.json.decode(was), msgspec.json.decode(now)
    path, before, after = _walk(old, new, "tick")
    return f"cycle {old['inputs']['cycle']}: {path} was {before!r}, is now {after!r}"


def _walk(old: Any, new: Any, path: str) -> tuple[str, Any, Any]:
    if isinstance(old, dict) and isinstance(new, dict):
        for key in [*old, *new]:
            if old.get(key) != new.get(key):
                return _walk(old.get(key), new.get(key), f"{path}.{key}")
    if isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for index, (one, other) in enumerate(zip(old, new, strict=True)):
            if one != other:
                return _walk(one, other, f"{path}[{index}]")
    return path, old, new
