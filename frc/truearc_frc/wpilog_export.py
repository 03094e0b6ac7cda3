"""A recorded session as WPILOG, which AdvantageScope and SysId open.

Append-only records of named signals, little-endian throughout. File: "WPILOG", version 1.0 (u16), length and text of
an extra header. Record: one byte that says how many bytes its signal number, payload size and time take, those three,
the payload. Signal 0 says which signals there are. Times are whole microseconds. A struct is its numbers in a row;
entries /.schema/struct:NAME say which. Sources: WPILib's datalog.adoc, and wpimath's Pose2dStruct.
"""

import json
import struct
from collections.abc import Sequence
from typing import IO

import msgspec

from truearc.robot.recording.export import ASSUMED, ExportRows, FieldPose, due, pose_of
from truearc.robot.recording.session import Trial, wall_time
from truearc.robot.recording.tabular import BOOL, FLOAT, FLOATS, INT, TEXT, TEXTS, Column, Value

TYPES = {FLOAT: "double", INT: "int64", BOOL: "boolean", TEXT: "string", TEXTS: "string[]", FLOATS: "double[]",
         "json": "json", "structschema": "structschema", "struct:Pose2d": "struct:Pose2d"}
CONTROL, START = 0, 0
SCHEMA, POSE = "structschema", "struct:Pose2d"
STRUCTS = {"Translation2d": "double x;double y", "Rotation2d": "double value",
           "Pose2d": "Translation2d translation;Rotation2d rotation"}


class WpilogWriter:
    """Writes one log to an open file, which the caller owns."""

    def __init__(self, file: IO[bytes], header: str) -> None:
        self._file = file
        self._signals = 0
        file.write(b"WPILOG" + struct.pack("<H", 0x0100) + _text(header))

    def start(self, name: str, kind: str, metadata: str, t_us: int) -> int:
        """Announce a signal of one of the kinds of TYPES; returns its number."""
        self._signals += 1
        self._record(CONTROL, t_us, struct.pack("<BI", START, self._signals)
                     + _text(name) + _text(TYPES[kind]) + _text(metadata))
        return self._signals

    def start_pose(self, name: str, metadata: str, t_us: int) -> int:
        """Announce a signal of poses, and how they are laid out."""
        for struct_name, fields in STRUCTS.items():
            self.append(self.start(f"/.schema/struct:{struct_name}", SCHEMA, "", t_us), t_us, fields.encode())
        return self.start(name, POSE, metadata, t_us)

    def append(self, signal: int, t_us: int, payload: bytes) -> None:
        """One value, as `make_payload` made it."""
        self._record(signal, t_us, payload)

    def _record(self, signal: int, t_us: int, payload: bytes) -> None:
        parts = [_shortest(signal), _shortest(len(payload)), _shortest(t_us)]
        sizes = len(parts[0]) - 1 | (len(parts[1]) - 1) << 2 | (len(parts[2]) - 1) << 4
        self._file.write(bytes([sizes]) + b"".join(parts) + payload)


class SignalChanges:
    """Appends to a log what differs from the last that was said of a signal."""

    def __init__(self, log: WpilogWriter) -> None:
        self._log = log
        self._said: dict[int, bytes] = {}

    def append(self, signal: int, t_us: int, payload: bytes | None) -> None:
        if payload is not None and payload != self._said.get(signal):
            self._said[signal] = payload
            self._log.append(signal, t_us, payload)


def write_wpilog(rows: ExportRows, file: IO[bytes]) -> None:
    """Every signal when it changes, under /estimate/hood_deg and the like, and each trial as JSON under /trial.

    Beside them, under the names that AdvantageScope knows: `DS:enabled` (armed), `systemTime` (wall clock, once), and
    `/pose`, a Pose2d of the robot before the target (truearc.robot.recording.export).
    """
    log = WpilogWriter(file, "truearc")
    changes = SignalChanges(log)
    numbers: list[int] = []
    enabled = pose = trial_number = 0
    trials = rows.trials_in_time()
    for tick, _ in rows.ticks():
        t_us = tick.inputs.t_ns // 1000
        if not numbers:
            numbers = [_start(log, column, t_us) for column in rows.columns]
            trial_number = log.start("/trial", "json", "", t_us)
            enabled = log.start("DS:enabled", BOOL, "", t_us)
            pose = log.start_pose("/pose", _said(source=ASSUMED), t_us)
            _write_wall_time(log, rows, tick.inputs.t_ns)
        for trial in due(trials, tick.inputs.t_ns):
            _log_trial(log, trial_number, trial)
        for number, column, value in zip(numbers, rows.columns, rows.flat.row(tick), strict=True):
            changes.append(number, t_us, make_payload(column.kind, value))
        changes.append(enabled, t_us, make_payload(BOOL, tick.memory.armed))
        changes.append(pose, t_us, pose_payload(pose_of(tick)))
    for trial in due(trials):
        _log_trial(log, trial_number, trial)


def _start(log: WpilogWriter, column: Column, t_us: int) -> int:
    return log.start("/" + column.name.replace(".", "/"), column.kind, _said(unit=column.unit) if column.unit else "",
                     t_us)


def _write_wall_time(log: WpilogWriter, rows: ExportRows, t_ns: int) -> None:
    """WPILib's own entry for it; none of an emulated robot."""
    wall = wall_time(rows.header)
    if wall.offset_ns:
        number = log.start("systemTime", INT, _said(source=wall.how, format="time_t_us"), t_ns // 1000)
        log.append(number, t_ns // 1000, make_payload(INT, (t_ns + wall.offset_ns) // 1000) or b"")


def _said(**metadata: str) -> str:
    return json.dumps(metadata)


def _log_trial(log: WpilogWriter, signal: int, trial: Trial) -> None:
    log.append(signal, trial.outcome.t_ns // 1000, msgspec.json.encode(trial))


def pose_payload(pose: FieldPose | None) -> bytes | None:
    """The bytes of a Pose2d; None for none."""
    return None if pose is None else struct.pack("<3d", *pose)


def make_payload(kind: str, value: Value) -> bytes | None:
    """The bytes of one value. An absent number is NaN, an absent text or list empty; None for what cannot be absent."""
    if kind == FLOAT:
        return struct.pack("<d", float("nan") if value is None else value)
    if kind == INT:
        return None if value is None else struct.pack("<q", value)
    if kind == BOOL:
        return None if value is None else bytes([bool(value)])
    if kind in (TEXT, "json"):
        return str(value or "").encode()
    items = value if isinstance(value, Sequence) else ()
    if kind == TEXTS:
        return struct.pack("<I", len(items)) + b"".join(_text(str(item)) for item in items)
    return struct.pack(f"<{len(items)}d", *items)


def _text(text: str) -> bytes:
    data = text.encode()
    return struct.pack("<I", len(data)) + data


def _shortest(number: int) -> bytes:
    return number.to_bytes(max(1, (number.bit_length() + 7) // 8), "little")
