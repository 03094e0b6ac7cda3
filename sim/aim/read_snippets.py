"""Tables in the shapes of `truearc.sim.aim.snippets`, read again."""

import json
import re
from collections.abc import Sequence
from pathlib import Path

from truearc.errors import InputError
from truearc.sim.data.columns import parse_number
from truearc.sim.data.table import Cell, RawTable

NUMBER = r"([^\s(),]+)"
PUT = re.compile(r"(\w+)\.put\((.*)\);")
PLAIN = re.compile(rf"{NUMBER}, {NUMBER}")
DEGREES = re.compile(rf"{NUMBER}, Rotation2d\.fromDegrees\({NUMBER}\)")
INTERPOLATING = re.compile(rf"new InterpolatingDouble\({NUMBER}\), new InterpolatingDouble\({NUMBER}\)")
# name of a map -> form of its entries, column of their keys, column of their values; "": the values are not compared
MAPS = {
    "hoodDeg": (PLAIN, "distance_m", "hood_deg"), "motorRpm": (PLAIN, "distance_m", "motor_rpm"),
    "leadDeg": (PLAIN, "distance_m", ""),
    "shotHoodAngleMap": (DEGREES, "distance_m", "hood_deg"),
    "shotFlywheelSpeedMap": (PLAIN, "distance_m", "motor_rad_s"), "timeOfFlightMap": (PLAIN, "distance_m", ""),
    "kLaserNewHoodMap": (INTERPOLATING, "distance_in", "hood_deg"),
    "kLaserRPMMap": (INTERPOLATING, "distance_in", "motor_rpm"),
}
FROM_VERTICAL = "shotHoodAngleMap"
CONFIGS = {"distance": "distance_in", "hoodEjectAngle": "hood_deg", "flywheelSpeed": "motor_rpm"}


def read_java(text: str, path: Path) -> RawTable:
    """The set points of the statements that `aim --format java`, `java-6328` and `java-254` write.

    Raises:
        InputError: names file and line of a statement in another form, or of a distance that one map has and another
            lacks.
    """
    found: dict[str, dict[str, tuple[int, float]]] = {}                  # column -> distance as written -> line, value
    keys = set[str]()
    for number, line in enumerate(map(str.strip, text.splitlines()), 1):
        if not line or line.startswith("//"):
            continue
        key, column, at, value = _entry(line, f"{path}:{number}")
        keys.add(key)
        if column and at in found.setdefault(column, {}):
            raise InputError(f"{path}:{number}: {column} at {at} stands in line {found[column][at][0]} already")
        if column:
            found[column][at] = number, value
    if len(keys) != 1 or len(found) != 2:
        raise InputError(f"{path}: is not a table of truearc aim --format java, java-6328 or java-254: it needs a map "
                         "of the hood and one of the motor")
    first, second = found.values()
    for at in [*first, *second]:
        if at not in first or at not in second:
            lines = [one[at][0] for one in (first, second) if at in one]
            raise InputError(f"{path}:{lines[0]}: {at} has no {' or '.join(c for c in found if at not in found[c])}")
    columns: dict[str, list[Cell]] = {keys.pop(): [float(at) for at in first]}
    columns |= {column: [entries[at][1] for at in first] for column, entries in found.items()}
    return RawTable(path, columns, [line for line, _ in first.values()])


def _entry(line: str, place: str) -> tuple[str, str, str, float]:
    """(column of the key, column of the value, the key as it is written, the value) of a statement."""
    put = PUT.fullmatch(line)
    form, key, column = MAPS.get(put[1], (None, "", "")) if put else (None, "", "")
    entry = form.fullmatch(put[2]) if put and form else None
    if put is None or entry is None:
        raise InputError(f"{place}: {line!r} is not an entry of a map as truearc aim writes it ({', '.join(MAPS)})")
    numbers = [parse_number(entry[group]) for group in (1, 2)]
    if numbers[0] is None or numbers[1] is None:
        raise InputError(f"{place}: {entry[1 + (numbers[0] is not None)]!r} is not a number")
    return key, column, entry[1], 90.0 - numbers[1] if put[1] == FROM_VERTICAL else numbers[1]


def read_json(text: str, path: Path, names: Sequence[str]) -> RawTable:
    """The rows of `aim --format json`, of which the columns `names`, or those of `json-3476`.

    Raises:
        InputError: the file is neither.
    """
    try:
        said = json.loads(text)
        team = "shooterConfigs" in said
        rows = said["shooterConfigs" if team else "rows"]
        wanted = CONFIGS if team else {name: name for name in names}
        columns: dict[str, list[Cell]] = {column: [_number(row[name]) for row in rows]
                                          for name, column in wanted.items()}
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: is not a table of truearc aim --format json or json-3476 ({error!r})") from error
    return RawTable(path, columns, list(range(1, len(rows) + 1)), in_memory=True)


def _number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{value!r} is not a number")
    return float(value)
