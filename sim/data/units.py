"""Columns in other units: `distance_ft`, `hood_rad` or `wheel_main_rpm` become the column that is read, converted."""

import difflib
import re
from collections.abc import Callable
from dataclasses import replace

from truearc.robot.config.unit_table import CONVERTED, ZERO, unit_of
from truearc.sim.data.columns import RANGES, TEXTS, WHEEL, WORDS, parse_number
from truearc.sim.data.table import Cell, Problems, RawTable

# columns of shots without a range of their own that code reads by name
OTHERS = ("config_id", "shot_id")
# column of shots -> words by which a name means it, unless it or one of these is there
SAID: dict[str, tuple[set[str], tuple[str, ...]]] = {
    "shot_id": ({"shot", "id"}, ()),
    "distance_m": ({"dist", "distance", "range"}, ()),
    "hood_deg": ({"hood", "angle", "elevation", "pitch"}, ("exit_deg",)),
    "motor_ratio": ({"ratio", "power", "throttle", "duty"}, ("exit_speed_m_s", WHEEL.pattern)),
    "outcome": ({"outcome", "result", "score", "scored"}, ("miss_height_m",)),
}
# names of columns that are mostly meant as one that is read, where that is not there
MEANT = {**dict.fromkeys(("time", "time_s", "timestamp", "timestamp_s"), "t_s"), "ball": "ball_id",
         **dict.fromkeys(("voltage", "voltage_v", "bus_v"), "battery_v"),
         **dict.fromkeys(("temp", "temp_c"), "temperature_c"),
         **dict.fromkeys(("exit_velocity_m_s", "velocity_m_s", "speed_m_s"), "exit_speed_m_s"),
         "spin_rpm": "exit_spin_rpm", "spin_rev_s": "exit_spin_rev_s"}
# names that say the motors' speed otherwise than by motor_ratio, and what to do with their numbers
MOTOR = re.compile(r"(motors?|flywheels?|shooter)_?(rpm|speed|velocity|rad_?s|rev_?s|rps|deg_?s|percent|pct|output)?"
                   r"(_(rpm|rad_s|rev_s|rps|deg_s|percent|pct))?|rpm|percent_output")
MOTOR_HOW = ("is not read; motor_ratio is the motors' speed by their free speed: divide by the free speed in the same "
             "unit, percent of it by 100, and name the column motor_ratio; or state each wheel: wheel_<name>_rpm, "
             "wheel_<name>_rad_s")
WHEELS = re.compile(r"wheels?_(rpm|rad_s|rev_s|speed|rps)")
NEAR = 0.85                           # likeness of a column's name to one that is read, above which it is a slip


def is_shot_column(name: str) -> bool:
    """Whether code reads a column of shots by this name."""
    return name in (*RANGES, *WORDS, *TEXTS, *OTHERS) or WHEEL.fullmatch(name) is not None


def in_read_units(table: RawTable, is_read: Callable[[str], bool], problems: Problems) -> RawTable:
    """Return the table with columns renamed and converted; case and blanks in their names do not matter.

    is_read: whether code reads a column of that name; others stay as they are. A problem is a column that stands for
    one which is there too, or whose name is nearly that of one which is read and is not there.
    """
    columns: dict[str, list[Cell]] = {}
    written = {}
    for name, cells in table.columns.items():
        read, factor, zero = read_as(name, is_read)
        if read in columns:
            problems.add(table.place(-1), name, f"stands for {read}, which is there already; keep one")
        if read != name:
            written[read] = (name, factor, zero)
        columns[read] = (cells if (factor, zero) == (1.0, 0.0) else
                         [_converted(cell, factor, zero) for cell in cells])
    driven = any(re.fullmatch(one, have) for one in ("motor_ratio", *SAID["motor_ratio"][1]) for have in columns)
    for name in columns:
        if is_read("motor_ratio") and not driven and MOTOR.fullmatch("_".join(name.lower().split())):
            problems.add(table.place(-1), name, MOTOR_HOW)
            continue
        meant = _meant(name, is_read, set(columns))
        if is_read("motor_ratio") and WHEELS.fullmatch("_".join(name.lower().split())):
            problems.add(table.place(-1), name, "names no wheel of the rig: wheel_<name>_rpm, or wheel_<name>_rad_s, "
                         "with the name of a [[launcher.wheel]] of rig.toml")
        elif meant:
            unit = unit_of(meant)
            others = ", ".join(meant.removesuffix(unit) + suffix for suffix in CONVERTED.get(unit, {}))
            problems.add(table.place(-1), name, f"is not a column that is read; did you mean {meant!r}?"
                         + (f" Of another unit: {others}" if others else ""))
    return replace(table, columns=columns, written=written)


def read_as(name: str, is_read: Callable[[str], bool]) -> tuple[str, float, float]:
    """The column that a name stands for, the factor of its numbers, and where they count from.

    The name itself, 1 and 0 where it is another column.
    """
    plain = "_".join(name.lower().split())
    if is_read(plain):
        return plain, 1.0, 0.0
    for unit, others in CONVERTED.items():
        for suffix, factor in others.items():
            read = plain.removesuffix(suffix) + unit
            if plain.endswith("_" + suffix) and is_read(read) and unit_of(read) == unit:
                return read, factor, ZERO.get(suffix, 0.0)
    return name, 1.0, 0.0


def _converted(cell: Cell, factor: float, zero: float) -> Cell:
    number = parse_number(cell)
    return cell if number is None else (number - zero) * factor


def _meant(name: str, is_read: Callable[[str], bool], there: set[str]) -> str | None:
    """The column that a name is nearly that of, or that it has a word for, unless that one is there too."""
    if is_read(name):
        return None
    words = set(re.split("[^a-z]+", name.lower()))
    for column, (said, instead) in SAID.items():
        if words & said and is_read(column) and not any(re.fullmatch(one, have) for one in (column, *instead)
                                                        for have in there):
            return column
    plain = "_".join(name.lower().split())
    if plain in MEANT and is_read("shot_id") and read_as(meant := MEANT[plain], is_read)[0] not in there:
        return meant
    plain = plain.removesuffix(unit_of(plain)).rstrip("_") if plain.startswith("wheel_") else plain
    without_unit = [f"{plain}_{unit}" for unit in CONVERTED if is_read(f"{plain}_{unit}")]
    like = difflib.get_close_matches(plain, [*RANGES, *WORDS, *OTHERS], 1, NEAR)
    return next((one for one in [*without_unit, *like] if is_read(one) and one not in there), None)
