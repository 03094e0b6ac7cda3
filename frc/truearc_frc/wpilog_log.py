"""WPILOG files as logs of series, by WPILib's own reader; damage is left out and named."""

import json
import struct
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from wpiutil.log import DataLogReader

from truearc.errors import InputError, load_bytes
from truearc.sim.data.log import BACK_US, Log, Series

MOST_BYTES = 2_000_000_000            # of one WPILOG
# WPILib's structs of doubles -> names of their numbers, as AdvantageScope shows them
STRUCTS = {"struct:Rotation2d": ("value",), "struct:Translation2d": ("x", "y"),
           "struct:Pose2d": ("translation/x", "translation/y", "rotation/value"),
           "struct:ChassisSpeeds": ("vx", "vy", "omega")}


def read_wpilog(path: Path, progress: Callable[[float], None] = lambda done: None) -> Log:
    """Every signal of numbers, booleans or texts, and the parts of arrays (`name/0`), JSON and WPILib's plane structs.

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

    def log(self, more: tuple[str, ...]) -> Log:
        """All signals; more: further damage."""
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
        if t_us < self._newest_us.get(entry, t_us) - BACK_US:
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
    elif kind in STRUCTS:
        raw = bytes(record.getRaw())
        for part, value in zip(STRUCTS[kind], struct.unpack(f"<{len(STRUCTS[kind])}d", raw), strict=True):
            yield f"{name}/{part}", value


def _parts(name: str, said: object) -> Iterator[tuple[str, float | str]]:
    """(name, value) of the numbers, truth values and texts in JSON, under the names of AdvantageScope."""
    if isinstance(said, dict | list):
        for key, value in said.items() if isinstance(said, dict) else enumerate(said):
            yield from _parts(f"{name}/{key}", value)
    elif said is not None:
        yield name, said if isinstance(said, str) else float(said)    # type: ignore[arg-type]


def _series(name: str, t_s: list[float], values: list[Any], unit: str) -> Series:
    """In the order of time; a log of several writers is not."""
    times = np.array(t_s)
    order = np.argsort(times, kind="stable")
    if any(isinstance(value, str) for value in values):
        return Series(name, times[order], tuple(str(values[k]) for k in order), unit)
    return Series(name, times[order], np.array(values, dtype=float)[order], unit)
