"""Deterministic replay, which recomputes every output of a recording and compares it bit for bit.

`replay` starts from the recorded inputs; `replay_frames` also recomputes the inputs from the raw CAN frames and the
kept images. Inputs that are in neither of these are taken as recorded: button presses, lost wires, and sightings whose
image was not kept (a session keeps the image used for each shot). `find_changes` replays with another configuration or
model and lists the differences.
"""

import itertools
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from msgspec import Struct
from msgspec.structs import replace

from truearc.errors import InputError, check_file, naming
from truearc.hw.devices.family import Encoder
from truearc.hw.protocols import NS, CameraFrame, Frame, LinkLost
from truearc.hw.reason import Reason
from truearc.robot.advice import ADVICE, advise_step
from truearc.robot.config.named_tables import encoder_family_of
from truearc.robot.config.schema import Config, plain_table
from truearc.robot.eyes import NoEyes
from truearc.robot.gate import Gate
from truearc.robot.reasons import BAD_FRAME, CAN_LOST
from truearc.robot.recording import files, tabular
from truearc.robot.recording import session as layout
from truearc.robot.recording.reader import TickReader
from truearc.robot.rig import HardwareRig, ReplayRig
from truearc.robot.runtime import RigLayer, RobotIo, run
from truearc.robot.sysid import POLICY, make_step
from truearc.robot.tick import step
from truearc.robot.types import Command, Inputs, Sent, Sighting, Tick
from truearc.robot.vision import find_target

OUTPUTS = ("estimate.", "aim.", "verdict.", "command.", "shot.", "outcomes")   # the rest is inputs, or memory


class Difference(Exception):
    """The first recomputed value that differs from the recorded one; the message names tick and field."""


class Replayed(NamedTuple):
    """The amounts that were bit-identical."""

    ticks: int
    cut_short: str | None             # what was wrong with the file's tail, if anything


class Recomputed(Struct):
    """How much of the inputs was recomputed from the wires."""

    frames: int = 0                   # parsed again
    seen: int = 0                     # sightings found again in their image
    taken: int = 0                    # sightings taken as recorded: their image was not kept
    missing: int = 0                  # images, or their index, that the session names but that are missing or broken
    ended: str = ""                   # why not every tick was recomputed


class Comparer:
    """A Recorder that keeps nothing and compares everything."""

    def __init__(self, rows: "RecordedRows") -> None:
        self._rows = rows

    def record(self, tick: Tick, sent: Sent) -> None:
        again = layout.encode_row(replace(tick, sent=sent))
        if again != self._rows.current:
            raise Difference(_first_difference(self._rows.current, again))

    def keep_picture(self, picture: CameraFrame) -> None: ...


class RecordedRows:
    """Feeds ticks to a ReplayRig while keeping the bytes of the current one.

    Difference if ticks were never recorded, since what follows cannot be recomputed from what came before.
    """

    def __init__(self, reader: TickReader) -> None:
        self._reader = reader
        self.current = b""

    def __iter__(self) -> Iterator[Tick]:
        before = 0
        for tick, row in self._reader:
            cycle = tick.inputs.cycle
            if cycle != before + 1:
                raise Difference(f"cycle {cycle} follows {before}: the ticks between are missing from the recording")
            self.current, before = row, cycle
            yield tick


def replay(session: Path) -> Replayed:
    """Recompute the outputs of every tick from its recorded inputs.

    Raises Difference at the first tick that does not match; InputError when there is nothing to match.
    """
    return _replay(session, lambda rows, config: ReplayRig(rows))


def replay_frames(session: Path) -> tuple[Replayed, Recomputed]:
    """Replay as `replay` does, with the inputs also recomputed from can0.log and frames/."""
    done = Recomputed()
    replayed = _replay(session, lambda rows, config: FramesRig(ReplayRig(rows), config, session, done))
    if done.frames == 0:
        raise InputError(f"{session}: no frames to parse again")
    return replayed._replace(cut_short=replayed.cut_short or done.ended or None), done


def _replay(session: Path, make_rig: Callable[[RecordedRows, Config], RobotIo]) -> Replayed:
    config, gate, reader = layout.load_session_config(session), layout.load_session_gate(session), TickReader(session)
    rows = RecordedRows(reader)
    aims = layout.load_session_aims(session)
    policy = layout.load_header(session).policy
    think = make_step(config) if policy == POLICY else partial(advise_step if policy == ADVICE else step, aims=aims)
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
    """Return dotted name, old and new value of each part that differs between two values of built-in types."""
    if isinstance(was, list | tuple) and isinstance(now, list | tuple) and len(was) == len(now):
        was, now = dict(enumerate(was)), dict(enumerate(now))
    if isinstance(was, dict) and isinstance(now, dict):
        for key in dict.fromkeys([*was, *now]):
            yield from find_differences(was.get(key), now.get(key), f"{prefix}{key}.")
    elif was != now:
        yield prefix.removesuffix("."), was, now


class LoggedBus:
    """truearc.hw.protocols.Bus that reads as many frames per tick from can0.log as were read when recording.

    Written frames are discarded.
    """

    def __init__(self, path: Path, done: Recomputed) -> None:
        self._path, self._done = path, done
        self._frames = self._read()
        self._count = 0
        self._lost: Reason | None = None

    def turn(self, inputs: Inputs) -> None:
        """Go to the tick with these `inputs`."""
        self._count = inputs.frames
        self._lost = next((fault for fault in inputs.faults if fault.code == CAN_LOST.name), None)

    def read(self) -> list[Frame]:
        if self._lost is not None:
            raise LinkLost(self._lost)
        frames = list(itertools.islice(self._frames, self._count))
        self._done.frames += len(frames)
        if len(frames) < self._count:
            self._done.ended = f"{self._path}: ends before the ticks do"
        return frames

    def write(self, frame: Frame) -> bool:
        return True

    def faults(self) -> list[Reason]:
        return []

    def _read(self) -> Iterator[Frame]:
        check_file(self._path)
        with naming(self._path):
            file = self._path.open(encoding="ascii", errors="replace", newline="\n")
        with file:
            for number, line in enumerate(file, 1):
                parsed = files.parse_candump(line)
                if parsed is None and line.endswith("\n"):
                    raise InputError(f"{self._path}:{number}: not a candump line")
                if parsed is not None and not parsed[1]:
                    yield parsed[0]


class FramesRig(RigLayer):
    """A ReplayRig whose inputs are recomputed by HardwareRig from the recorded frames and images."""

    def __init__(self, ticks: ReplayRig, config: Config, session: Path, done: Recomputed) -> None:
        super().__init__(ticks)
        self.done = done
        self.done.missing += not (session / layout.INDEX).exists()
        self._config, self._session = config, session
        self._bus = LoggedBus(session / layout.CAN, self.done)
        self._clock = _RecordedClock()
        self._is_wired = encoder_family_of(config.hood_encoder).make_off_bus is None
        self._parser = HardwareRig(config, self._bus, _NoBox(), NoEyes(), self._clock, lambda: False,
                                None if self._is_wired else Encoder())
        self._pictures = {picture.t_ns: picture for picture in files.load_pictures(session)}

    def read(self) -> Inputs | None:
        recorded = self._rig.read()
        if recorded is None:
            return None
        self._clock.t_ns = recorded.t_ns
        self._bus.turn(recorded)
        parsed = self._parser.read()
        if parsed is None or self.done.ended:
            return None
        return replace(recorded, flywheels=parsed.flywheels, hood_motor=parsed.hood_motor, feeder=parsed.feeder,
                       hood_angle=parsed.hood_angle if self._is_wired else recorded.hood_angle,
                       sighting=self._see(recorded.sighting), faults=self._faults(recorded.faults, parsed.faults))

    def write(self, command: Command) -> Sent:
        """Return what was sent when recording; drivers get the command, since some of their faults depend on it."""
        self._parser.write(command)
        return self._rig.write(command)

    def _see(self, sighting: Sighting | None) -> Sighting | None:
        if sighting is None:
            return None
        picture = self._pictures.get(sighting.t_ns)
        image = None if picture is None else files.load_image(self._session, picture)
        self.done.seen += image is not None
        self.done.taken += image is None
        self.done.missing += picture is not None and image is None
        return sighting if image is None else find_target(image, self._config)

    def _faults(self, recorded: tuple[Reason, ...], parsed: tuple[Reason, ...]) -> tuple[Reason, ...]:
        """Faults that the frames show now, with the other recorded ones."""
        again, was = (tuple(fault for fault in faults if fault.code == BAD_FRAME.name or "motor" in fault.params)
                      for faults in (parsed, recorded))
        if again == was:
            return recorded
        return again + tuple(fault for fault in recorded if fault not in was)


class _RecordedClock:
    def __init__(self) -> None:
        self.t_ns = 0

    def now_ns(self) -> int:
        return self.t_ns

    def sleep_until_ns(self, t_ns: int) -> None: ...


class _NoBox:
    def read(self) -> bytes:
        return b""

    def close(self) -> None: ...


class Change(Struct):
    """One output that differed in some ticks. Largest: of numbers, the largest change."""

    name: str
    unit: str
    ticks: int
    first_s: float
    was: tabular.Value
    now: tabular.Value
    largest: float | None = None
    largest_s: float = 0.0


class Flip(Struct):
    """One tick whose verdict changed."""

    t_s: float
    fired: bool                       # then; now it is the other way round
    reasons: tuple[Reason, ...]       # of whichever is a HOLD


class Changes(Struct):
    """All differences. Times count from the recording's first tick."""

    ticks: int = 0
    differing: int = 0                # ticks in which an output changed
    remembering: int = 0              # ticks in which nothing but memory changed
    fired: int = 0
    fires: int = 0
    outputs: dict[str, Change] = {}
    flips: list[Flip] = []
    cut_short: str | None = None


def find_changes(session: Path, config: Config, gate: Gate | None) -> Changes:
    """Replay a session's inputs with another configuration or gate; InputError if there is nothing to replay.

    The inputs stay as recorded: what the robot would have sensed after acting otherwise, no replay can know.
    """
    reader = TickReader(session)
    rig = ReplayRig(RecordedRows(reader))
    collector = _Collector(rig, len(config.axes.flywheels))
    ticks = run(rig, config, gate, collector)
    collector.changes.cut_short = matched(ticks, reader).cut_short
    return collector.changes


def config_changes(was: Config, now: Config) -> list[str]:
    """Return each key that differs, as 'flywheel.pid.kp: 0.03 -> 0.04'."""
    differences = find_differences(plain_table(was), plain_table(now))
    return [f"{name}: {old} -> {new}" for name, old, new in differences]


class _Collector:
    """A Recorder that compares, and goes on."""

    def __init__(self, rig: ReplayRig, flywheels: int) -> None:
        self.changes = Changes()
        self._rig, self._flat = rig, tabular.FlatTicks(flywheels)
        self._first_ns: int | None = None

    def record(self, tick: Tick, sent: Sent) -> None:
        was, changes = self._rig.recorded, self.changes
        assert was is not None
        self._first_ns = was.inputs.t_ns if self._first_ns is None else self._first_ns
        t_s = (was.inputs.t_ns - self._first_ns) * NS
        changes.ticks += 1
        changes.fired += was.verdict.fire
        changes.fires += tick.verdict.fire
        now = layout.decode_tick(layout.encode_row(replace(tick, sent=sent)))
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
