"""DanielR723's own `shooter.py` -> the table that exit_speeds reads. It is read as text and never run."""

import math
from itertools import pairwise
from pathlib import Path

from truearc.errors import InputError
from truearc.sim.data.columns import parse_number
from truearc.sim.data.table import Cell, Problems, RawTable, load_table
from truearc_proof.importers.originals import PYTHON_COMMENT, matching, scaled

ARRAY = r"(?m)^{}[ \t]*=[ \t]*np\.array\(\[(?P<cells>[^\[\]]*)\]\)"
NUMBER = r"(?m)^{}[ \t]*=(?P<cell>[^\n]*)$"
SAME = {"hood_elevation_deg": "angle_min", "ball_mass_kg": "m", "ball_radius_m": "R"}     # column -> its name there


def load_fuel(path: Path, problems: Problems) -> tuple[RawTable, tuple[str, ...]]:
    """`shooter.py` or a table in CSV; and what was left out.

    Spin is in rad/s, as their equations use it. Where motor speeds start again, the elevation is not stated.
    """
    if path.suffix != ".py":
        return load_table(path, problems), ()
    rpm, speed, spin = (_array(path, name) for name in ("test_rpm", "test_speed", "test_spin"))
    if not len(rpm) == len(speed) == len(spin):
        raise InputError(f"{path}: test_rpm, test_speed and test_spin have {len(rpm)}, {len(speed)} and {len(spin)} "
                       "numbers, and should have as many")
    first = _first_run(rpm)
    columns: dict[str, list[Cell]] = {name: [_number(path, there)] * first for name, there in SAME.items()}
    columns |= {"motor_rpm": rpm[:first], "exit_speed_mps": speed[:first],
                "spin_rev_s": scaled(spin, 0.5 / math.pi)[:first]}
    line = _once(path, ARRAY.format("test_rpm")).lines[0]
    more = len(rpm) - first
    left_out = f"{path}:{line}: {more} more, where motor speeds start again: at another elevation, which is not stated"
    return RawTable(path, columns, [line] * first), (left_out,) if more else ()


def _once(path: Path, pattern: str) -> RawTable:
    found = matching(path, pattern, PYTHON_COMMENT)
    if len(found.lines) > 1:
        raise InputError(f"{path}:{found.lines[1]}: stands in line {found.lines[0]} already; which of them holds?")
    return found


def _number(path: Path, name: str) -> float:
    found = _once(path, NUMBER.format(name))
    (cell,), (line,) = found.columns["cell"], found.lines
    number = parse_number(cell)
    if number is None or not math.isfinite(number):
        raise InputError(f"{path}:{line}: {name}: {cell!r} is not a finite number")
    return number


def _array(path: Path, name: str) -> list[Cell]:
    cells = _once(path, ARRAY.format(name)).columns["cells"][0]
    return [cell.strip() or None for cell in str(cells or "").rstrip(",").split(",")]


def _first_run(rpm: list[Cell]) -> int:
    """How many there are before a speed that is not above the one before."""
    speeds = [parse_number(cell) for cell in rpm]
    falls = [k for k, (before, here) in enumerate(pairwise(speeds), start=1)
             if before is not None and here is not None and here <= before]
    return falls[0] if falls else len(rpm)
