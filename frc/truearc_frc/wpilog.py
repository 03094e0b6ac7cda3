"""Export of a session to a WPILOG file for AdvantageScope and SysId, and import of WPILOG logs as series.

A WPILOG file is an append-only sequence of records of named signals; its numbers are little-endian. The file begins
with "WPILOG", the version 1.0 (u16), and the length and text of an extra header. A record begins with one byte that
states the lengths of the signal number, the payload size and the time; these three follow, and then the payload. The
records of signal 0 declare the other signals. Times are whole microseconds. A struct is stored as the sequence of its
numbers, which an entry named /.schema/struct:NAME declares. Sources: WPILib's datalog.adoc and wpimath's Pose2dStruct.

Logs are read with WPILib's own reader; damaged parts are skipped and reported.
"""

import json
import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import msgspec
import numpy as np
from wpiutil.log import DataLogReader

from truearc.errors import InputError, load_bytes
from truearc.robot.recording.export import ASSUMED, ExportRows, due, pose_of
from truearc.robot.recording.session import Trial, wall_time
from truearc.robot.recording.tabular import BOOL, FLOAT, FLOATS, INT, TEXT, TEXTS, Column, Value

if TYPE_CHECKING:                     # needs pyarrow, which a robot that writes logs does without
    from truearc.sim.data.log import Log, Series

# --- out

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
        """Declare a signal of one of the kinds of TYPES; return its number."""
        self._signals += 1
        self.append(CONTROL, t_us, struct.pack("<BI", START, self._signals)
                    + _text(name) + _text(TYPES[kind]) + _text(metadata))
        return self._signals

    def start_pose(self, name: str, metadata: str, t_us: int) -> int:
        """Declare a signal of poses and their layout."""
        for struct_name, fields in STRUCTS.items():
            self.append(self.start(f"/.schema/struct:{struct_name}", SCHEMA, "", t_us), t_us, fields.encode())
        return self.start(name, POSE, metadata, t_us)

    def append(self, signal: int, t_us: int, payload: bytes) -> None:
        """Append one value from `make_payload`, or a declaration for signal 0."""
        parts = [_shortest(signal), _shortest(len(payload)), _shortest(t_us)]
        sizes = len(parts[0]) - 1 | (len(parts[1]) - 1) << 2 | (len(parts[2]) - 1) << 4
        self._file.write(bytes([sizes]) + b"".join(parts) + payload)


def write_wpilog(rows: ExportRows, file: IO[bytes]) -> None:
    """Write every signal when it changes, under /estimate/hood_deg and the like, and each trial as JSON under
    /trial.

    Beside them, under the names that AdvantageScope knows: `DS:enabled` (armed), `systemTime` (wall clock, once), and
    `/pose`, a Pose2d of the robot before the target (truearc.robot.recording.export).
    """
    log = WpilogWriter(file, "truearc")
    said: dict[int, bytes] = {}

    def change(signal: int, t_us: int, payload: bytes | None) -> None:
        if payload is not None and payload != said.get(signal):
            said[signal] = payload
            log.append(signal, t_us, payload)

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
            change(number, t_us, make_payload(column.kind, value))
        change(enabled, t_us, make_payload(BOOL, tick.memory.armed))
        place = pose_of(tick)
        change(pose, t_us, None if place is None else struct.pack("<3d", *place))
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


def make_payload(kind: str, value: Value) -> bytes | None:
    """Return the bytes of one value. A missing number is NaN, a missing text or list empty; None if it cannot be
    missing."""
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


# --- in

MOST_BYTES = 2_000_000_000            # of one WPILOG
# WPILib's structs of doubles -> names of their numbers, as AdvantageScope shows them
DOUBLES = {"struct:Rotation2d": ("value",), "struct:Translation2d": ("x", "y"),
           "struct:Pose2d": ("translation/x", "translation/y", "rotation/value"),
           "struct:ChassisSpeeds": ("vx", "vy", "omega")}


def read_wpilog(path: Path, progress: Callable[[float], None] = lambda done: None) -> "Log":
    """Read every signal of numbers, booleans or texts, and the parts of arrays (`name/0`), JSON and WPILib's plane
    structs.

    Raises:
        InputError: there is no such file, or it is not a WPILOG.

    Records that are damaged or cut short are left out, and named in `damage`.
    """
    data = load_bytes(path, MOST_BYTES)
    reader = iter(DataLogReader(data, str(path)))
    taken, end = _Wpilog(), 0
    for number, (place, after) in enumerate(_whole_records(data, path)):
        record = next(reader, None)
        if record is None:
            break
        if number % 100_000 == 0:
            progress(place / len(data) if number else 0.0)
        taken.take(place, record)
        end = after
    cut = f"ends in the record at byte {end} of {len(data)}: cut short, as where power is lost; shots may be missing"
    return taken.log(() if end == len(data) else (cut,))


class _Wpilog:
    """Takes the records of a WPILOG, in their order; what is damaged is counted by kind, with its first byte."""

    def __init__(self) -> None:
        from truearc.sim.data.log import BACK_US
        self._back_us = BACK_US
        self._entries: dict[int, tuple[str, str, str]] = {}   # name, kind, unit
        self._times: dict[str, list[float]] = {}
        self._values: dict[str, list[Any]] = {}
        self._units: dict[str, str] = {}
        self._newest_us: dict[int, int] = {}
        self._damage: dict[str, list[int]] = {}

    def take(self, place: int, record: Any) -> None:
        try:
            if record.isControl():
                self._control(place, record)
            elif (entry := record.getEntry()) in self._entries:
                self._value(place, record, entry)
            else:
                self._add(place, "a value of no signal")
        except (TypeError, ValueError, struct.error):         # WPILib's reader raises the first two
            self._add(place, "a value that is none of its signal's kind")

    def log(self, more: tuple[str, ...]) -> "Log":
        """All signals; more: further damage."""
        from truearc.sim.data.log import Log
        damage = tuple(f"damaged: byte {place}: {what}" + (f"; {count} of these" if count > 1 else "")
                       + "; shots may be missing" for what, (place, count) in self._damage.items())
        return Log({name: _series(name, times, self._values[name], self._units[name])
                    for name, times in self._times.items()}, damage + more)

    def _control(self, place: int, record: Any) -> None:
        if record.isStart():
            start = record.getStartData()
            self._entries[start.entry] = start.name, start.type, _unit(start.metadata)
        elif record.isSetMetadata():
            changed = record.getSetMetadataData()
            if changed.entry in self._entries:
                name, kind, unit = self._entries[changed.entry]
                self._entries[changed.entry] = name, kind, _unit(changed.metadata) or unit
        elif not record.isFinish():
            self._add(place, "a record that announces nothing")

    def _value(self, place: int, record: Any, entry: int) -> None:
        name, kind, unit = self._entries[entry]
        t_us = record.getTimestamp()
        if t_us < self._newest_us.get(entry, t_us) - self._back_us:
            self._add(place, "time goes back")
        self._newest_us[entry] = t_us
        for part, value in _values(name, kind, record):
            self._times.setdefault(part, []).append(t_us * 1e-6)
            self._values.setdefault(part, []).append(value)
            self._units[part] = unit

    def _add(self, place: int, what: str) -> None:
        self._damage.setdefault(what, [place, 0])[1] += 1


def _whole_records(data: bytes, path: Path) -> Iterator[tuple[int, int]]:
    """(first byte, end) of each complete record: WPILib's reader gives the last one twice where the file ends within
    one."""
    if data[:6] != b"WPILOG" or len(data) < 12:
        raise InputError(f"{path}: is not a WPILOG: it does not begin with that word")
    place = 12 + struct.unpack_from("<I", data, 8)[0]
    while place < len(data):
        sizes = data[place]
        number, size, time = (sizes & 3) + 1, (sizes >> 2 & 3) + 1, (sizes >> 4 & 7) + 1
        length = int.from_bytes(data[place + 1 + number:place + 1 + number + size], "little")
        first, place = place, place + 1 + number + size + time + length
        if place <= len(data):
            yield first, place


def _unit(metadata: str) -> str:
    """AdvantageKit and truearc state it as JSON."""
    try:
        said = json.loads(metadata) if metadata else {}
    except ValueError:
        return ""
    unit = said.get("unit") if isinstance(said, dict) else None
    return unit if isinstance(unit, str) else ""


def _values(name: str, kind: str, record: Any) -> Iterator[tuple[str, float | str]]:
    """(name, value) of each number or text of a record; nothing of a kind that has none.

    Raises:
        TypeError, ValueError or struct.error: the record is damaged. JSON that is none is a text only.
    """
    single = {"double": "getDouble", "float": "getFloat", "int64": "getInteger", "boolean": "getBoolean",
              "string": "getString", "json": "getString"}
    several = {"double[]": "getDoubleArray", "float[]": "getFloatArray", "int64[]": "getIntegerArray",
               "boolean[]": "getBooleanArray", "string[]": "getStringArray"}
    if kind in single:
        value = getattr(record, single[kind])()
        yield name, value if isinstance(value, str) else float(value)
        if kind == "json":
            with suppress(ValueError, RecursionError, OverflowError):
                yield from _parts(name, json.loads(value))
    elif kind in several:
        for number, value in enumerate(getattr(record, several[kind])()):
            yield f"{name}/{number}", value if isinstance(value, str) else float(value)
    elif kind in DOUBLES:
        raw = bytes(record.getRaw())
        for part, value in zip(DOUBLES[kind], struct.unpack(f"<{len(DOUBLES[kind])}d", raw), strict=True):
            yield f"{name}/{part}", value


def _parts(name: str, said: object) -> Iterator[tuple[str, float | str]]:
    """(name, value) of the numbers, truth values and texts in JSON, under the names of AdvantageScope."""
    if isinstance(said, dict | list):
        for key, value in said.items() if isinstance(said, dict) else enumerate(said):
            yield from _parts(f"{name}/{key}", value)
    elif said is not None:
        yield name, said if isinstance(said, str) else float(said)    # type: ignore[arg-type]


def _series(name: str, t_s: list[float], values: list[Any], unit: str) -> "Series":
    """In the order of time; a log of several writers is not."""
    from truearc.sim.data.log import Series
    times = np.array(t_s)
    order = np.argsort(times, kind="stable")
    if any(isinstance(value, str) for value in values):
        return Series(name, times[order], tuple(str(values[k]) for k in order), unit)
    return Series(name, times[order], np.array(values, dtype=float)[order], unit)
