"""Exit speeds that teams measured at several speeds of their wheels -> dataset, without outcomes.

proof/IMPORTERS.md says what the columns are, where they come from, and what is assumed of each launcher.
"""

import math
from itertools import pairwise
from pathlib import Path

import numpy as np

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Air, Ball, Believe, LauncherFacts, Rig, Wheel
from truearc.sim.data.columns import need_columns, number_column, parse_number
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.data.table import Cell, Problems, RawTable, gathered, load_table
from truearc_proof.importers.originals import PYTHON_COMMENT, matching, scaled
from truearc_proof.importers.set_points import BALL, RELEASE_M, WHEEL_M

SPEEDS_971 = ("ball_speed_mps", "accelerator_rad_s")
# in constants.cc: rows {ball speed, {wheels beside the ball, finisher}} of the flywheels' table
TABLE_971 = r"flywheel_shot_interpolation_table\s*=[^;]*"
ORIGINAL_971 = r"\{(?P<ball_speed_mps>[^{},]*),\s*\{(?P<accelerator_rad_s>[^{},]*),[^{},]*\}\s*\}"
NO_ELEVATION_DEG = 45.0               # placeholder where none was noted: no speed and no spin depends on it
COLUMNS_FUEL = ("hood_elevation_deg", "motor_rpm", "exit_speed_mps", "spin_rev_s", "ball_mass_kg", "ball_radius_m")
RELEASE_FUEL_M = 0.39
ARRAY_FUEL = r"(?m)^{}[ \t]*=[ \t]*np\.array\(\[(?P<cells>[^\[\]]*)\]\)"
NUMBER_FUEL = r"(?m)^{}[ \t]*=(?P<cell>[^\n]*)$"
SAME_FUEL = {"hood_elevation_deg": "angle_min", "ball_mass_kg": "m", "ball_radius_m": "R"}  # column -> its name there


def import_971(speeds: str | Path) -> Dataset:
    """Team 971 (2020): what a ball leaves with for each speed of the two wheels beside it; CSV or their constants.cc.

    InputError names file, line and column of each bad row.
    """
    path = Path(speeds)
    with gathered() as problems:
        table = matching(path, ORIGINAL_971, within=TABLE_971) if path.suffix == ".cc" else load_table(path, problems)
        need_columns(table, SPEEDS_971)
        speed_m_s, wheel_rad_s = (_positive(table, name, problems) for name in SPEEDS_971)
    wheels = tuple(Wheel(name, WHEEL_M, 1.0, clock_deg) for name, clock_deg in (("left", 270.0), ("right", 90.0)))
    shots = Shots(_ids(table), {"hood_deg": np.full(len(speed_m_s), NO_ELEVATION_DEG), "wheel_left_rad_s": wheel_rad_s,
                                "wheel_right_rad_s": wheel_rad_s, "exit_speed_m_s": speed_m_s}, {})
    return Dataset("frc-971", Rig(BALL, LauncherFacts(RELEASE_M, None, wheels), air=Air(1.2),
                                    believe=Believe(("gravity", "exit_efficiency"))), shots)


def import_fuel(speeds: str | Path) -> Dataset:
    """Exit speed and backspin off video at one elevation (DanielR723/shooter); the wheels' size is not known.

    CSV or their shooter.py. InputError names file, line and column of each bad row.
    """
    with gathered() as problems:
        table, left_out = load_fuel(Path(speeds), problems)
        need_columns(table, COLUMNS_FUEL)
        hood_deg, spin_rev_s = (number_column(table, name, problems) for name in ("hood_elevation_deg", "spin_rev_s"))
        rpm, speed_m_s, mass_kg, radius_m = (
            _positive(table, name, problems)
            for name in ("motor_rpm", "exit_speed_mps", "ball_mass_kg", "ball_radius_m"))
    # their spin is about the other axis: negative lifts the ball
    shots = Shots(_ids(table), {"hood_deg": hood_deg, "motor_rpm": rpm, "exit_speed_m_s": speed_m_s,
                                "exit_spin_rev_s": -spin_rev_s, "mass_kg": mass_kg, "radius_m": radius_m}, {})
    ball = Ball(float(mass_kg[0]), float(radius_m[0])) if len(rpm) else BALL
    return Dataset("fuel", Rig(ball, LauncherFacts(RELEASE_FUEL_M), air=Air(1.2), believe=Believe()), shots,
                   left_out=left_out)


def _ids(table: RawTable) -> tuple[str, ...]:
    return tuple(f"{row + 1:02d}" for row in range(len(table.lines)))


def _positive(table: RawTable, name: str, problems: Problems) -> np.ndarray:
    values = number_column(table, name, problems)
    for row, value in enumerate(values):
        if math.isfinite(value) and value <= 0.0:
            problems.add(table.place(row), name, f"{value:g} must be above 0")
    return values


def load_fuel(path: Path, problems: Problems) -> tuple[RawTable, tuple[str, ...]]:
    """`shooter.py`, read as text and never run, or a table in CSV; and what was left out.

    Spin is in rad/s, as their equations use it. Where motor speeds start again, the elevation is not stated.
    """
    if path.suffix != ".py":
        return load_table(path, problems), ()
    rpm, speed, spin = (_array(path, name) for name in ("test_rpm", "test_speed", "test_spin"))
    if not len(rpm) == len(speed) == len(spin):
        raise InputError(f"{path}: test_rpm, test_speed and test_spin have {len(rpm)}, {len(speed)} and {len(spin)} "
                       "numbers, and should have as many")
    first = _first_run(rpm)
    columns: dict[str, list[Cell]] = {name: [_number(path, there)] * first for name, there in SAME_FUEL.items()}
    columns |= {"motor_rpm": rpm[:first], "exit_speed_mps": speed[:first],
                "spin_rev_s": scaled(spin, 0.5 / math.pi)[:first]}
    line = _once(path, ARRAY_FUEL.format("test_rpm")).lines[0]
    more = len(rpm) - first
    left_out = f"{path}:{line}: {more} more, where motor speeds start again: at another elevation, which is not stated"
    return RawTable(path, columns, [line] * first), (left_out,) if more else ()


def _once(path: Path, pattern: str) -> RawTable:
    found = matching(path, pattern, PYTHON_COMMENT)
    if len(found.lines) > 1:
        raise InputError(f"{path}:{found.lines[1]}: stands in line {found.lines[0]} already; which of them holds?")
    return found


def _number(path: Path, name: str) -> float:
    found = _once(path, NUMBER_FUEL.format(name))
    (cell,), (line,) = found.columns["cell"], found.lines
    number = parse_number(cell)
    if number is None or not math.isfinite(number):
        raise InputError(f"{path}:{line}: {name}: {cell!r} is not a finite number")
    return number


def _array(path: Path, name: str) -> list[Cell]:
    cells = _once(path, ARRAY_FUEL.format(name)).columns["cells"][0]
    return [cell.strip() or None for cell in str(cells or "").rstrip(",").split(",")]


def _first_run(rpm: list[Cell]) -> int:
    """How many there are before a speed that is not above the one before."""
    speeds = [parse_number(cell) for cell in rpm]
    falls = [k for k, (before, here) in enumerate(pairwise(speeds), start=1)
             if before is not None and here is not None and here <= before]
    return falls[0] if falls else len(rpm)
