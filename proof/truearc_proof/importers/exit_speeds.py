"""Exit speeds that teams measured at several speeds of their wheels -> dataset, without outcomes.

proof/IMPORTERS.md says what the columns are, where they come from, and what is assumed of each launcher.
"""

import math
from pathlib import Path

import numpy as np

from truearc.robot.config.rig_spec import Air, Ball, Believe, LauncherFacts, Rig, Wheel
from truearc.sim.data.columns import need_columns, number_column
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.data.table import Problems, RawTable, gathered, load_table
from truearc_proof.importers.fuel import load_fuel
from truearc_proof.importers.originals import matching
from truearc_proof.importers.set_points import BALL, RELEASE_M, WHEEL_M

SPEEDS_971 = ("ball_speed_mps", "accelerator_rad_s")
# in constants.cc: rows {ball speed, {wheels beside the ball, finisher}} of the flywheels' table
TABLE_971 = r"flywheel_shot_interpolation_table\s*=[^;]*"
ORIGINAL_971 = r"\{(?P<ball_speed_mps>[^{},]*),\s*\{(?P<accelerator_rad_s>[^{},]*),[^{},]*\}\s*\}"
NO_ELEVATION_DEG = 45.0               # placeholder where none was noted: no speed and no spin depends on it
COLUMNS_FUEL = ("hood_elevation_deg", "motor_rpm", "exit_speed_mps", "spin_rev_s", "ball_mass_kg", "ball_radius_m")
RELEASE_FUEL_M = 0.39


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
