"""Importers of individually recorded shots: a team's log with outcomes, and exit speeds measured from phone clips.

proof/IMPORTERS.md describes the columns, their origin, and the assumptions about each robot.
"""

import math
from pathlib import Path

import numpy as np

from truearc.robot.config.rig_spec import Air, Ball, Believe, LauncherFacts, Noise, Rig, Target, Wheel
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.data.table import Problems, RawTable, gathered, load_table, need_columns, number_column, text_column
from truearc_proof.importers.set_points import HALL, WHEEL_M

REV = 2.0 * math.pi
MS, MM = 1e-3, 1e-3
RESULTS = {"good": ("two", ""), "over": ("miss", "high"), "under": ("miss", "low")}
# source: the game's manual: a ball of 5 inches and 2.6 oz, an opening between the lip at 38.75 and the top at 54 inches
FTC_BALL, FTC_GOAL = Ball(0.075, 0.0635), Target(1.178, 0.0, 0.194)
FTC_WHEEL_M, FTC_RELEASE_M, FTC_HOOD_DEG = 0.048, 0.35, 50.0     # assumed: not stated
FUEL, FUEL_RELEASE_M = Ball(0.215, 0.075), 0.5                   # the release is assumed; no exit depends on it
FTC_COLUMNS = ("session", "time_ms", "set_rps", "measured_rps", "hood_position", "distance_mm", "result")
FUEL_COLUMNS = ("set_rps", "exit_speed_m_s", "exit_deg", "lowest_rps_during_shot")


def import_ftc_decode(log: str | Path) -> Dataset:
    """Import a team's log of shots at a goal that they went through, over or under; `session`, and `day` by its name.

    `t_s` counts from a session's first shot. Shots without a speed or a distance are left out. InputError names file,
    line and column of each bad row.
    """
    with gathered() as problems:
        table = load_table(Path(log), problems)
        need_columns(table, FTC_COLUMNS)
        session, result = (text_column(table, name, problems) for name in ("session", "result"))
        time_ms, set_rps, rps, servo, distance_mm = (number_column(table, name, problems)
                                                     for name in FTC_COLUMNS[1:-1])
        _check_words(table, result, problems)
    rows = np.flatnonzero((rps > 0.0) & (distance_mm > 0.0))
    named = [session[row] for row in rows]
    first = {name: min(time_ms[[row for row in rows if session[row] == name]]) for name in named}
    said = [RESULTS[result[row]] for row in rows]
    numbers = {"distance_m": distance_mm[rows] * MM, "hood_deg": np.full(len(rows), FTC_HOOD_DEG),
               "wheel_main_rad_s": rps[rows] * REV, "wheel_hood_rad_s": np.zeros(len(rows)),
               "set_point_rad_s": set_rps[rows] * REV, "hood_servo": servo[rows],
               "t_s": np.array([time_ms[row] - first[session[row]] for row in rows]) * MS}
    texts = {"outcome": tuple(word for word, _ in said), "side": tuple(side for _, side in said),
             "session": tuple(named), "day": tuple(name[:len("2025_11_27")] for name in named)}
    left = len(session) - len(rows)
    return Dataset("ftc-decode", _rig(FTC_BALL, FTC_RELEASE_M, FTC_WHEEL_M, FTC_GOAL),
                   Shots(tuple(f"{row:03d}" for row in rows), numbers, texts),
                   left_out=(f"{left} shots without a speed or a distance",) if left else ())


def import_fuel_clips(clips: str | Path) -> Dataset:
    """Import exit speeds and angles that were measured on phone clips. InputError names each bad row."""
    with gathered() as problems:
        table = load_table(Path(clips), problems)
        need_columns(table, FUEL_COLUMNS)
        rps, speed_m_s, exit_deg, lowest = (number_column(table, name, problems) for name in FUEL_COLUMNS)
    numbers = {"wheel_main_rad_s": rps * REV, "wheel_hood_rad_s": np.zeros(len(rps)), "exit_speed_m_s": speed_m_s,
               "exit_deg": exit_deg, "lowest_rad_s": lowest * REV}
    rig = _rig(FUEL, FUEL_RELEASE_M, WHEEL_M, None)
    return Dataset("fuel-clips", rig, Shots(tuple(f"{row:02d}" for row in range(1, len(rps) + 1)), numbers, {}))


def _check_words(table: RawTable, result: tuple[str, ...], problems: Problems) -> None:
    for row, word in enumerate(result):
        if word not in RESULTS:
            problems.add(table.place(row), "result", f"{word!r} is not one of {', '.join(RESULTS)}")


def _rig(ball: Ball, release_m: float, wheel_m: float, goal: Target | None) -> Rig:
    """One wheel against a hood that stands still."""
    wheels = (Wheel("main", wheel_m, 1.0, 180.0), Wheel("hood", wheel_m, 0.0, 0.0))
    believed = ("gravity", "exit_efficiency") if goal is None else ("gravity", "drag", "magnus", "exit_efficiency")
    return Rig(ball, LauncherFacts(release_m, None, wheels), goal, Air(1.2), noise=Noise(), site=HALL,
               believe=Believe(believed))
