"""WPILOG, which AdvantageScope and SysId open: append-only records of named signals, little-endian throughout.

File: "WPILOG", version 1.0 (u16), length and text of an extra header. Record: one byte that says how many bytes its
signal number, payload size and time take, those three, the payload. Signal 0 says which signals there are. Times are
whole microseconds. A struct is its numbers in a row; entries /.schema/struct:NAME say which. Sources: WPILib's
datalog.adoc, and wpimath's Pose2dStruct.
"""

import struct
from collections.abc import Sequence
from typing import IO

from truearc.robot.recording.export.field_pose import FieldPose
from truearc.robot.recording.export.tabular import BOOL, FLOAT, FLOATS, INT, TEXT, TEXTS, Value

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
