"""What another configuration or model would have made of a recording's inputs, and how that differs from what was."""

from pathlib import Path

import msgspec
from msgspec import Struct

from truearc.hw.protocols import CameraFrame
from truearc.hw.reason import Reason
from truearc.robot.config.hashing import table_of
from truearc.robot.config.schema import Config
from truearc.robot.gate.model import Gate
from truearc.robot.recording.export.tabular import FlatTicks, Value
from truearc.robot.recording.reader import TickReader
from truearc.robot.recording.replay.recompute import RecordedRows, find_differences, matched
from truearc.robot.recording.rows import RowFormat
from truearc.robot.rig import ReplayRig
from truearc.robot.runtime import run
from truearc.robot.types import Sent, Tick

OUTPUTS = ("estimate.", "aim.", "verdict.", "command.", "shot.", "outcomes")   # the rest is inputs, or memory
NS = 1e-9


class Change(Struct):
    """One output that came out different in some ticks. Largest: of numbers, the largest change."""

    name: str
    unit: str
    ticks: int
    first_s: float
    was: Value
    now: Value
    largest: float | None = None
    largest_s: float = 0.0


class Flip(Struct):
    """One tick whose verdict is another."""

    t_s: float
    fired: bool                       # then; now it is the other way round
    reasons: tuple[Reason, ...]       # of whichever is a HOLD


class Changes(Struct):
    """All that differs. Times count from the recording's first tick."""

    ticks: int = 0
    differing: int = 0                # ticks in which an output changed
    remembering: int = 0              # ticks in which nothing but memory changed
    fired: int = 0
    fires: int = 0
    outputs: dict[str, Change] = {}
    flips: list[Flip] = []
    cut_short: str | None = None


def find_changes(session: Path, config: Config, gate: Gate | None) -> Changes:
    """Replay a session's inputs with another configuration or gate; InputError when there is nothing to replay.

    The inputs stay as recorded: what the robot would have sensed after acting otherwise, no replay can know.
    """
    reader = TickReader(session)
    rig = ReplayRig(RecordedRows(reader))
    collector = _Collector(rig, reader.rows, len(config.axes.flywheels))
    ticks = run(rig, config, gate, collector)
    collector.changes.cut_short = matched(ticks, reader).cut_short
    return collector.changes


def config_changes(was: Config, now: Config) -> list[str]:
    """Each key that differs, as 'flywheel.pid.kp: 0.03 -> 0.04'."""
    differences = find_differences(table_of(was), table_of(now))
    return [f"{name}: {old} -> {new}" for name, old, new in differences]


class _Collector:
    """A Recorder that compares, and goes on."""

    def __init__(self, rig: ReplayRig, rows: RowFormat, flywheels: int) -> None:
        self.changes = Changes()
        self._rig, self._rows = rig, rows
        self._flat = FlatTicks(flywheels)
        self._first_ns: int | None = None

    def record(self, tick: Tick, sent: Sent) -> None:
        was, changes = self._rig.recorded, self.changes
        assert was is not None
        self._first_ns = was.inputs.t_ns if self._first_ns is None else self._first_ns
        t_s = (was.inputs.t_ns - self._first_ns) * NS
        changes.ticks += 1
        changes.fired += was.verdict.fire
        changes.fires += tick.verdict.fire
        now = self._rows.decode_tick(self._rows.encode_tick(msgspec.structs.replace(tick, sent=sent)))
        if now != was:
            outputs = self._compare(was, now, t_s)
            changes.differing += outputs
            changes.remembering += not outputs
        if tick.verdict.fire != was.verdict.fire:
            changes.flips.append(Flip(t_s, was.verdict.fire, tick.verdict.reasons or was.verdict.reasons))

    def keep_picture(self, picture: CameraFrame) -> None: ...

    def _compare(self, was: Tick, now: Tick, t_s: float) -> bool:
        """Note every output that differs; whether there was one."""
        found = False
        for column, old, new in zip(self._flat.columns, self._flat.row(was), self._flat.row(now), strict=True):
            if old == new or not column.name.startswith(OUTPUTS):
                continue
            found = True
            change = self.changes.outputs.get(column.name)
            if change is None:
                change = self.changes.outputs[column.name] = Change(column.name, column.unit, 0, t_s, old, new)
            change.ticks += 1
            if isinstance(old, float) and isinstance(new, float) and abs(new - old) > (change.largest or 0.0):
                change.largest, change.largest_s = abs(new - old), t_s
        return found
