"""Importers of exit speeds and set points published by FRC teams.

Each set point is treated as a shot through the middle of the goal. proof/IMPORTERS.md describes the columns, their
origin, and the assumptions about each robot.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from pathlib import Path

import numpy as np

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Air, Ball, Believe, LauncherFacts, Noise, Rig, Site, Target, Wheel
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.data.table import (
    Cell,
    Problems,
    RawTable,
    gathered,
    load_table,
    need_columns,
    number_column,
    parse_number,
    text_column,
    text_of,
)
from truearc_proof.importers.originals import INCH_M, json_rows, matching, scaled

NUMBER_254 = r"new InterpolatingDouble\((?P<{}>[^()]*)\)"
HOOD_254 = (r"kLaser(?P<ball>Old|Medium|New)HoodMap\.put\(" + NUMBER_254.format("inches") + r",\s*"
            + NUMBER_254.format("hood"))
SPEED_254 = r"kLaserRPMMap\.put\(" + NUMBER_254.format("inches") + r",\s*" + NUMBER_254.format("rpm")
BEYOND_IN = 12.0                      # where the team went on in a straight line, so as not to clamp
STRAIGHT_DEG = 1e-4
Point = tuple[float | None, float | None]
# a distance in inches, and a vector of the hood's elevation and the wheel's speed
TUNING_2910 = (r"SHOOTER_TUNING\.put\(\s*new InterpolatingDouble\((?P<inches>[^()]*)\),\s*"
          r"new Vector2\(\s*Math\.toRadians\((?P<hood>[^()]*)\),\s*(?P<rpm>[^()]*)\)")
NO_DATE = "2021-01-01T00:00:00+00:00" # of a file without one: all its set points are of one moment
RPM = 2.0 * math.pi / 60.0
BALL = Ball(0.142, 0.0889)            # team 2910's notebook: 0.142 kg, 0.1778 m
GOAL_M = 2.4956                       # 98.25 in, the field drawings of 2020
OPENING_M = (0.0762, 0.381)           # half heights: the ball's margin in the inner port; 30 in across flats outside
WHEEL_M = 0.0508                      # 4 in
RELEASE_M = 0.75                      # assumed: not stated
DISTANCE_M = 0.05
# source: rules of 2020 and 2021, whose matches are played in halls; teams tune in their workshops and school gyms
HALL = Site(indoor=True)


def load_254(path: Path, problems: Problems) -> RawTable:
    """Load `Constants.java` or a CSV table; repeated rows of the Java file are taken once."""
    if path.suffix != ".java":
        return load_table(path, problems)
    found = matching(path, HOOD_254)
    rpm = matching(path, SPEED_254).columns["rpm"]
    if len(set(rpm)) > 1:
        raise InputError(f"{path}: kLaserRPMMap has several speeds; a version with one is needed")
    rows = list(zip(*(found.columns[name] for name in ("ball", "inches", "hood")), strict=True))
    kept = [k for k, row in enumerate(rows) if row not in rows[:k]]
    ball, inches, hood = ([found.columns[name][k] for k in kept] for name in ("ball", "inches", "hood"))
    points = list(zip(ball, map(parse_number, inches), map(parse_number, hood), strict=True))
    columns: dict[str, list[Cell]] = {
        "team": ["254"] * len(kept), "table": [f"laser_{str(name).lower()}_ball" for name in ball],
        "distance_m": scaled(inches, INCH_M), "wheel_rpm": [rpm[0]] * len(kept), "hood_raw": hood,
        "note": ["EXTRAPOLATED" if is_extrapolated((x, y), [(a, b) for other, a, b in points if other == name])
                 else None for name, x, y in points]}
    return RawTable(path, columns, [found.lines[k] for k in kept])


def is_extrapolated(point: Point, table: list[Point]) -> bool:
    """Return whether this is a table's last point, BEYOND_IN from the previous one and in line with the two before."""
    known = sorted((x, y) for x, y in table if x is not None and y is not None)
    if len(known) < 3 or point != known[-1]:
        return False
    (x0, y0), (x1, y1), (x2, y2) = known[-3:]
    return abs(x2 - x1 - BEYOND_IN) < 1e-6 and abs(y1 + (y1 - y0) / (x1 - x0) * (x2 - x1) - y2) < STRAIGHT_DEG


def load_2910(path: Path, problems: Problems) -> RawTable:
    """Load `TargetWithShooterCommand.java` or a CSV table."""
    if path.suffix != ".java":
        return load_table(path, problems)
    found = matching(path, TUNING_2910)
    count = len(found.lines)
    columns: dict[str, list[Cell]] = {
        "team": ["2910"] * count, "table": ["shooter_tuning"] * count,
        "distance_m": scaled(found.columns["inches"], INCH_M), "wheel_rpm": found.columns["rpm"],
        "hood_raw": found.columns["hood"], "note": [None] * count}
    return RawTable(path, columns, found.lines)


def load_3476(path: Path, problems: Problems) -> RawTable:
    """Load dated versions from a CSV table, or one from the team's own JSON file, which has no date."""
    if path.suffix != ".json":
        return load_table(path, problems)
    found = json_rows(text_of(path), path, "shooterConfigs", ("distance", "hoodEjectAngle", "flywheelSpeed"))
    count = len(found.lines)
    return RawTable(path, {"commit": [path.stem] * count, "committed_at": [NO_DATE] * count,
                           "distance_m": scaled(found.columns["distance"], INCH_M),
                           "hood_eject_angle_deg": found.columns["hoodEjectAngle"],
                           "flywheel_rpm": found.columns["flywheelSpeed"]}, found.lines)


@dataclass(frozen=True)
class Robot:
    """How one team's numbers are read.

    elevation_deg: of its `hood_raw`; `taken`: its tables, by the ball they are for; a wheel of WHEEL_M runs against a
    fixed hood. load: its own files, or CSV.
    """

    team: str
    taken: dict[str, str]
    elevation_deg: Callable[[float], float]
    load: Callable[[Path, Problems], RawTable] = load_table


# larger numbers are flatter shots (its hood's home, 45, is the steepest); counted from the vertical
ROBOT_254 = Robot("254", {"laser_old_ball": "old", "laser_medium_ball": "medium", "laser_new_ball": "new"},
                  lambda raw: 90.0 - raw, load_254)
ROBOT_2910 = Robot("2910", {"west_valley": "", "shooter_tuning": ""}, lambda raw: raw, load_2910)


def import_set_points(tables: str | Path, robot: Robot) -> Dataset:
    """Return one shot per set point, in the file's order; `ball_quality` if the team names the ball it was tuned for.

    InputError names file, line and column of each bad row. Set points that the team itself extrapolated are omitted.
    """
    with gathered() as problems:
        table = robot.load(Path(tables), problems)
        need_columns(table, ("team", "table", "distance_m", "wheel_rpm", "hood_raw", "note"))
        team, name = text_column(table, "team", problems), text_column(table, "table", problems)
        mine = [row for row in range(len(team)) if team[row] == robot.team and name[row] in robot.taken]
        numbers = _numbers(table, mine, ("distance_m", "wheel_rpm", "hood_raw"), problems)
    if not mine:
        raise InputError(f"{tables}: column team: has no set points of {robot.team}")
    guessed = [row for row in mine if "EXTRAPOLATED" in str(table.columns["note"][row] or "")]
    kept = np.array([row not in guessed for row in mine])
    rows = [row for row in mine if row not in guessed]
    distance_m, wheel_rpm, hood = numbers[kept].T
    texts = {"table": tuple(name[row] for row in rows)}
    if any(robot.taken.values()):
        texts["ball_quality"] = tuple(robot.taken[name[row]] for row in rows)
    shots = _shots(tuple(f"{name[row]}-{k:02d}" for k, row in enumerate(rows)), distance_m, wheel_rpm,
                   np.array([robot.elevation_deg(raw) for raw in hood]), {}, texts)
    left_out = tuple(f"{table.place(row)}: extrapolated by the team" for row in guessed)
    return Dataset(f"frc-{robot.team}", _rig(), shots, left_out=left_out)


# their Constants.java and TargetWithShooterCommand.java, or CSV
import_254, import_2910 = (partial(import_set_points, robot=robot) for robot in (ROBOT_254, ROBOT_2910))


def import_3476(history: str | Path) -> Dataset:
    """Import team 3476 (2021): dated versions of one table; a shot for each set point that a version changed.

    `t_s` counts from the first version. Set points that a version kept are left out. All versions are in one CSV; one
    version alone can be read from its own shooterconfig.json.
    """
    with gathered() as problems:
        table = load_3476(Path(history), problems)
        need_columns(table, ("commit", "committed_at", "distance_m", "hood_eject_angle_deg", "flywheel_rpm"))
        commit, when = text_column(table, "commit", problems), text_column(table, "committed_at", problems)
        numbers = _numbers(table, [*range(len(commit))], ("distance_m", "flywheel_rpm", "hood_eject_angle_deg"),
                           problems)
        time_s = np.array([_time_s(table, row, text, problems) for row, text in enumerate(when)])
    order = sorted(range(len(commit)), key=lambda row: (time_s[row], row))
    rows, before = [], set[tuple[float, ...]]()
    for version in dict.fromkeys(commit[row] for row in order):
        points = {tuple(numbers[row]): row for row in order if commit[row] == version}
        rows += [row for point, row in points.items() if point not in before]
        before = set(points)
    distance_m, wheel_rpm, hood_deg = numbers[rows].T
    shots = _shots(tuple(f"{commit[row]}-{row:03d}" for row in rows), distance_m, wheel_rpm, hood_deg,
                   {"t_s": time_s[rows] - time_s.min()}, {"version": tuple(commit[row] for row in rows)})
    same = len(commit) - len(rows)
    return Dataset("frc-3476", _rig(), shots,
                   left_out=(f"{same} set points that a version left as they were",) if same else ())


def _numbers(table: RawTable, rows: list[int], names: tuple[str, ...], problems: Problems) -> np.ndarray:
    """[rows, names]; only those rows have to have numbers."""
    chosen = RawTable(table.path, {name: [table.columns[name][row] for row in rows] for name in names},
                   [table.lines[row] for row in rows])
    return np.stack([number_column(chosen, name, problems) for name in names], axis=1)


def _time_s(table: RawTable, row: int, text: str, problems: Problems) -> float:
    try:
        return datetime.fromisoformat(text).timestamp()
    except ValueError:
        problems.add(table.place(row), "committed_at", f"{text!r} is not a date with time (ISO 8601)")
        return 0.0


def _shots(shot_id: tuple[str, ...], distance_m: np.ndarray, wheel_rpm: np.ndarray, hood_deg: np.ndarray,
           more: dict[str, np.ndarray], texts: dict[str, tuple[str, ...]]) -> Shots:
    still = np.zeros(len(shot_id))
    return Shots(shot_id, {"distance_m": distance_m, "hood_deg": hood_deg, "wheel_main_rad_s": wheel_rpm * RPM,
                           "wheel_hood_rad_s": still, "miss_height_m": still, **more}, texts)


def _rig() -> Rig:
    wheels = (Wheel("main", WHEEL_M, 1.0, 180.0), Wheel("hood", WHEEL_M, 0.0, 0.0))
    return Rig(BALL, LauncherFacts(RELEASE_M, None, wheels), Target(GOAL_M, *OPENING_M), Air(1.2), site=HALL,
               noise=Noise(distance_m=DISTANCE_M), believe=Believe(("gravity", "drag", "magnus", "exit_efficiency")))


# --- exit speeds

SPEEDS_971 = ("ball_speed_mps", "accelerator_rad_s")
# in constants.cc: rows {ball speed, {wheels beside the ball, finisher}} of the flywheels' table
TABLE_971 = r"flywheel_shot_interpolation_table\s*=[^;]*"
ORIGINAL_971 = r"\{(?P<ball_speed_mps>[^{},]*),\s*\{(?P<accelerator_rad_s>[^{},]*),[^{},]*\}\s*\}"
NO_ELEVATION_DEG = 45.0               # placeholder where none was noted: no speed and no spin depends on it


def import_971(speeds: str | Path) -> Dataset:
    """Import team 971 (2020): exit speed for each speed of the two wheels beside the ball; CSV or their
    constants.cc.

    InputError names file, line and column of each bad row.
    """
    path = Path(speeds)
    with gathered() as problems:
        table = matching(path, ORIGINAL_971, within=TABLE_971) if path.suffix == ".cc" else load_table(path, problems)
        need_columns(table, SPEEDS_971)
        speed_m_s, wheel_rad_s = (_positive(table, name, problems) for name in SPEEDS_971)
    wheels = tuple(Wheel(name, WHEEL_M, 1.0, clock_deg) for name, clock_deg in (("left", 270.0), ("right", 90.0)))
    shots = Shots(tuple(f"{row:02d}" for row in range(1, len(speed_m_s) + 1)), {
        "hood_deg": np.full(len(speed_m_s), NO_ELEVATION_DEG), "wheel_left_rad_s": wheel_rad_s,
        "wheel_right_rad_s": wheel_rad_s, "exit_speed_m_s": speed_m_s}, {})
    return Dataset("frc-971", Rig(BALL, LauncherFacts(RELEASE_M, None, wheels), air=Air(1.2), site=HALL,
                                    believe=Believe(("gravity", "exit_efficiency"))), shots)


def _positive(table: RawTable, name: str, problems: Problems) -> np.ndarray:
    values = number_column(table, name, problems)
    for row, value in enumerate(values):
        if math.isfinite(value) and value <= 0.0:
            problems.add(table.place(row), name, f"{value:g} must be above 0")
    return values
