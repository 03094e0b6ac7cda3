"""Names, words and files as teams have them: what is guessed, what is asked, servo positions and workbooks."""

import builtins
import shlex
from collections.abc import Callable
from datetime import date, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import truearc as ta
from tests.sim.data.test_guess_table import RIG
from truearc.cli.main import main
from truearc.robot.config.shot_map import as_signal
from truearc.robot.config.units import in_unit, unit_in
from truearc.sim.data.guess_map import time_column
from truearc.sim.data.import_shots import guess
from truearc.sim.data.table import any_table

PRINTED = RIG.replace("three_half_height_m = 0.0", "three_half_height_m = 0.07")       # every rig that init writes
SERVO = '[launcher.hood]\nmap = [[0.2, 35.0], [0.5, 45.0], [0.8, 58.0]]\n'
FTC = "session,time_ms,set_rps,measured_rps,hood_position,distance_mm,result"
RENAMED = "session,Timestamp,SetRPS,ActualRPS,hood_position,DistanceMM,result"


def write(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def ftc_table(folder: Path, header: str, shots: int = 40, words: tuple[str, ...] = ("good", "over", "under")) -> Path:
    """A team's log of shots: seconds apart, wheels that are set by the distance, a hood that hardly moves."""
    rng = np.random.default_rng(7)
    at_ms = 1_764_311_194_052 + np.cumsum(rng.integers(4_000, 60_000, shots))
    lines = [header, f"monday,{at_ms[0] - 9000},0.00,0.00,0.200,-1.0,{words[0]}"]
    for k, distance_mm in enumerate(rng.uniform(1300.0, 3600.0, shots)):
        wanted = 22.0 + 0.0072 * distance_mm
        lines.append(f"{'monday' if k < 25 else 'tuesday'},{at_ms[k]},{wanted:.2f},{wanted + rng.normal(0, 0.4):.2f},"
                     f"{0.8 if k % 9 else 0.5},{distance_mm:.1f},{words[k % len(words)]}")
    return write(folder, "decode.csv", "\n".join(lines) + "\n")


@pytest.mark.parametrize(("header", "keys"), [(FTC, ("distance_mm", "measured_rps", "time_ms")),
                                              (RENAMED, ("DistanceMM", "ActualRPS", "Timestamp"))])
def test_an_ftc_teams_names_are_known(header: str, keys: tuple[str, ...], tmp_path: Path) -> None:
    rig, mine = write(tmp_path, "rig.toml", RIG), ftc_table(tmp_path, header)
    found = guess([mine], rig)
    assert found.map.rows == "shot" and not found.asked
    said = {column: as_signal(one) for column, one in found.map.columns.items()}
    assert [(said[column].key, said[column].unit) for column in ("distance_m", "motor_rad_s", "t_s")] == [
        (keys[0], "mm"), (keys[1], "rps"), (keys[2], "ms")]
    assert "hood_deg" not in said and said["hood_position"].key == "hood_position"
    assert any("not an angle" in line and "[launcher.hood] map = [[" in line for line in found.lines)
    dataset = ta.import_shots([mine], rig=rig)
    shots = dataset.shots
    assert 1.3 < np.nanmin(shots.number("distance_m")) < np.nanmax(shots.number("distance_m")) < 3.6
    assert np.isnan(shots.number("distance_m")[0])
    assert any("-1 (once) is read as an unknown" in line for line in dataset.left_out)
    assert set(shots.number("hood_position")) == {0.2, 0.5, 0.8} and np.isnan(shots.number("hood_deg")).all()
    assert shots.text("outcome")[1:4] == ("two", "miss", "miss") and shots.text("side")[2:4] == ("high", "low")


def test_a_servo_is_an_angle_by_the_measured_points(tmp_path: Path) -> None:
    mine, rig = ftc_table(tmp_path, FTC), write(tmp_path, "rig.toml", RIG + SERVO)
    found = ta.import_shots([mine], rig=rig)
    assert set(found.shots.number("hood_deg")) == {35.0, 45.0, 58.0}
    ta.save_dataset(tmp_path / "out", found)
    assert ta.load_rig(tmp_path / "out" / "rig.toml").launcher == found.facts.launcher
    assert set(ta.load_dataset(tmp_path / "out").shots.number("hood_deg")) == {35.0, 45.0, 58.0}
    between = ta.dataset({"shot_id": ["a", "b"], "hood_position": [0.65, None]}, rig=ta.load_rig(rig))
    np.testing.assert_allclose(between.shots.number("hood_deg"), [51.5, np.nan])
    with pytest.raises(ta.InputError, match=r"hood_position: 0.9 is outside the measured points .* 0.2 to 0.8"):
        ta.dataset({"shot_id": ["a"], "hood_position": [0.9]}, rig=ta.load_rig(rig))


@pytest.mark.parametrize(("points", "message"), [
    ("[[0.2, 35.0]]", "needs two measured points or more"), ("[[0.8, 35.0], [0.2, 58.0]]", "positions must rise"),
    ("[[0.2, 35.0], [0.5, 58.0], [0.8, 40.0]]", "degrees must rise at each point, or fall at each"),
    ("[[0.2, 35.0], [0.8, 35.0]]", "degrees must rise"), ("[[0.2, 35.0], [0.8, 158.0]]", "from 0 to 90"),
    ("[[0.2, nan], [0.8, 35.0]]", "not finite"), ("[0.2, 35.0]", "a list"), ("[[0.2, 35.0, 1.0]]", "length 2"),
    ('[["low", 35.0], [0.8, 58.0]]', "a number")])
def test_a_wrong_map_of_the_servo_is_named(points: str, message: str, tmp_path: Path) -> None:
    rig = write(tmp_path, "rig.toml", f"{RIG}[launcher.hood]\nmap = {points}\n")
    with pytest.raises(ta.InputError) as refused:
        ta.load_rig(rig)
    assert "launcher.hood.map" in str(refused.value) and message in str(refused.value)


@pytest.mark.parametrize(("names", "headings", "columns"), [
    (("lower", "upper"), ("Lower RPM", "Upper RPM"), ["wheel_lower_rad_s", "wheel_upper_rad_s"]),
    (("main",), ("mainWheelRPM",), ["wheel_main_rad_s"]), (("main",), ("Wheel (rpm)",), ["wheel_main_rad_s"]),
    (("lower", "upper"), ("Lower RPM", "Feeder RPM"), ["motor_rad_s"]),
    (("main",), ("Motor of wheel (RPM)",), ["motor_rad_s"]), (("main",), ("Flywheel RPM",), ["motor_rad_s"])])
def test_a_heading_that_names_a_wheel_of_the_rig_is_its_speed_not_its_motors(names, headings, columns, tmp_path):
    wheel = RIG[RIG.index("[[launcher.wheel]]"):RIG.index("[target]")]
    rig = write(tmp_path, "rig.toml", RIG.replace(wheel, "".join(wheel.replace("main", name) for name in names)))
    mine = write(tmp_path, "mine.csv", f"Dist (ft),Angle,{','.join(headings)},Result\n" + "".join(
        f"{10 + k},45,{','.join([str(3300 + 10 * k)] * len(headings))},in\n" for k in range(8)))
    found = guess([mine], rig).map.columns
    assert [column for column in found if "rad_s" in column] == columns
    shots = ta.import_shots([mine], rig=rig).shots
    if columns[0] != "motor_rad_s":
        assert shots.number(columns[-1])[0] == pytest.approx(3300 * np.pi / 30)


def test_a_flywheel_beside_gears_is_the_motor_and_the_guess_says_so(tmp_path: Path) -> None:
    rig = write(tmp_path, "rig.toml", RIG.replace("gear = 1.0", "gear = 0.5"))
    mine = write(tmp_path, "mine.csv", "Dist (ft),Angle,Flywheel RPM,Result\n" + "10,45,3300,in\n" * 8)
    assert ("motor_rad_s: Flywheel RPM is taken to be the motors' speed: by its gear, wheel main turns 0.5 times as "
            "fast; if these are the wheels' own speeds, state times = 2 for it in the map") in guess([mine], rig).lines


@pytest.mark.parametrize(("heading", "unit"), [
    ("ExitSpeedMS", "m_s"), ("VelocityMPS", "m_s"), ("exitVelocityFps", "ft_s"), ("LaunchSpeedMph", "mph"),
    ("Muzzle velocity (m/s)", "m_s")])
def test_speeds_of_the_ball_are_read_in_the_units_teams_write(heading: str, unit: str, tmp_path: Path) -> None:
    mine = write(tmp_path, "mine.csv", f"Dist (ft),Angle,{heading},Result\n" + "".join(
        f"{10 + k},45,{20 + k},in\n" for k in range(8)))
    found = guess([mine], write(tmp_path, "rig.toml", RIG)).map.columns["exit_speed_m_s"]
    assert (as_signal(found).key, as_signal(found).unit) == (heading, unit)


@pytest.mark.parametrize(("angle", "deg"), [("ExitAngleDeg", 6.0), ("Exit angle from vertical (deg)", 84.0)])
def test_stated_exit_speeds_need_no_wheel(angle: str, deg: float, tmp_path: Path) -> None:
    launcher = RIG[RIG.index("free_speed_rad_s"):RIG.index("[target]")]
    rig = write(tmp_path, "rig.toml", RIG.replace(launcher, ""))
    mine = write(tmp_path, "mine.csv", f"Shot,DistanceFt,{angle},ExitSpeedFtS,Outcome\n" + "".join(
        f"{k},{12 + 2 * k},{6 + k},{40 + 3 * k},{('in', 'short')[k % 2]}\n" for k in range(12)))
    shots = ta.import_shots([mine], rig=rig).shots
    assert [shots.number(name)[0] for name in ("distance_m", "exit_deg", "exit_speed_m_s")] == pytest.approx(
        [12 * 0.3048, deg, 40 * 0.3048])


def test_a_table_with_a_row_per_outcome_is_no_log(tmp_path: Path) -> None:
    for words, found in ((("true", "false", "false"), True), (("in", "rim", "miss"), True), (("idle", "in"), False)):
        mine = write(tmp_path, "mine.csv", "Timestamp,ActualRPS,DistanceMM,HoodAngle,Scored\n" + "".join(
            f"{20 * k + 3.2:.1f},{47 + k % 9},2000,48.{k % 10},{words[k % len(words)]}\n" for k in range(50)))
        assert (time_column(any_table(mine)) is None) == found


TABLE = "Dist (ft),Angle,RPM,Result\n"


def rows(*words: str) -> str:
    return TABLE + "".join(f"{10 + k},45,{3300 + k},{word}\n" for k, word in enumerate(words))


@pytest.mark.parametrize(("rig", "words", "proposed"), [
    (PRINTED, ("in", "rim", "short", "long"), "in=three,rim=two,short=miss-low,long=miss-high"),
    (RIG, ("in", "rim", "short", "long"), "in=hit,rim=hit,short=miss-low,long=miss-high"),
    (RIG, ("made", "bounce?", "miss"), "made=hit,bounce?=hit,miss=miss"),
    (RIG, ("in", "rim in", "back rim", "off rim"), "in=hit,rim in=hit,back rim=miss-high,off rim=miss"),
    (PRINTED, ("two", "rim in", "in and out"), "two=two,rim in=two,in and out=miss"),
    (PRINTED, ("inner", "outer", "miss"), "inner=three,outer=two,miss=miss")])
def test_a_word_that_is_not_certain_is_asked_about(rig, words, proposed, tmp_path, capsys):
    mine, out = write(tmp_path, "mine.csv", rows(*words, *words)), tmp_path / "out"
    line = ["import", "csv", str(mine), "--rig", str(write(tmp_path, "rig.toml", rig)), "-o", str(out), "--guess"]
    assert main(line) == 2
    asked = capsys.readouterr().err
    assert f"{mine}: Result: the meaning is not certain of" in asked and f"{words[1]!r} (2 times)" in asked
    assert f"--guess --outcomes '{proposed}'" in asked.replace(f"--outcomes {proposed}", f"--outcomes '{proposed}'")
    assert ("'in' (2 times)" in asked) == ("in" in words and rig == PRINTED) and not out.exists()
    assert main([*line, "--outcomes", proposed]) == 0
    found = ta.load_dataset(out).shots.text("outcome")
    assert len(found) == 2 * len(words) - 2 * proposed.count("rejected")


def test_a_word_of_certain_meaning_needs_no_answer_and_python_has_the_question_too(tmp_path: Path) -> None:
    rig = write(tmp_path, "rig.toml", PRINTED)
    sure = write(tmp_path, "sure.csv", rows("two", "3", "missed low", "over", "n/a"))
    assert ta.import_shots([sure], rig=rig).shots.text("outcome") == ("two", "three", "miss", "miss")
    open_ = write(tmp_path, "open.csv", rows("two", "rim", "miss"))
    with pytest.raises(ta.InputError, match=r"'rim' \(once\)\. Proposed: rim = two; .*outcomes=\{'two': 'two', 'rim'"):
        ta.import_shots([open_], rig=rig)
    assert ta.import_shots([open_], rig=rig, outcomes={"rim": "miss"}).shots.text("outcome") == ("two", "miss", "miss")
    for outcomes, message in (({"rom": "two"}, "no outcome is called rom; there are two, rim, miss"),
                              ({"rim": "perhaps"}, "rim = perhaps: is none of miss-low")):
        with pytest.raises(ta.InputError, match=message):
            ta.import_shots([open_], rig=rig, outcomes=outcomes)


def test_words_that_are_not_in_the_data_are_left_out_of_the_next_command(tmp_path, capsys):
    mine, rig = write(tmp_path, "makes.csv", rows("in", "in")), write(tmp_path, "rig.toml", PRINTED)
    line = ["import", "csv", str(mine), "--rig", str(rig), "-o", str(tmp_path / "out"), "--guess", "--outcomes"]
    assert main([*line, "Rim=two,in=three,short=miss-low"]) == 2
    said = capsys.readouterr().err.strip()
    assert "no outcome is called rim, short; there are in\n" in said
    assert main(shlex.split(said.rpartition(": truearc ")[2])) == 0


def test_a_hit_by_a_map_is_named_by_the_word_of_the_data(tmp_path: Path) -> None:
    mine, rig = write(tmp_path, "mine.csv", rows("short", "in")), write(tmp_path, "rig.toml", PRINTED)
    shot_map = write(tmp_path, "shots.toml", guess([write(tmp_path, "other.csv", rows("in", "short"))],
                                                   write(tmp_path, "alike.toml", RIG)).to_toml())
    with pytest.raises(ta.InputError, match=r"mine\.csv:3: outcome: 'in' is a hit by the map, which may be a two or a"):
        ta.import_shots([mine], rig=rig, shot_map=shot_map)


def test_a_logs_uncertain_words_are_asked_about_and_its_idle_ones_are_not(tmp_path: Path) -> None:
    at_s = np.arange(0.0, 40.0, 0.02)
    rpm = np.where(np.abs(at_s % 10.0 - 5.0) < 0.1, 2700.0, 3000.0)
    rpm += np.random.default_rng(1).normal(0.0, 5.0, len(at_s))
    words = ["IDLE" if t % 10.0 < 6.0 or t % 10.0 > 6.5 else ("rim", "three", "miss")[int(t // 10) % 3] for t in at_s]
    lines = [f"{t:.2f},{3.0 + t / 50:.3f},{45 + t / 20:.2f},{speed},{word}"
             for t, speed, word in zip(at_s, rpm, words, strict=True)]
    log = write(tmp_path, "loops.csv", "\n".join(["Time (s),Distance,Angle,FlywheelRPM,Result", *lines]))
    rig = write(tmp_path, "rig.toml", PRINTED)
    assert (column := time_column(any_table(log))) is not None and (column.column, column.unit) == ("Time (s)", "s")
    asked = guess([log], rig).asked
    assert "certain of 'rim'" in asked and "idle" not in asked
    found = ta.import_shots([log], rig=rig, outcomes={"rim": "two"})
    assert found.shots.text("outcome") == ("two", "three", "miss", "two")
    assert not any("idle" in line for line in found.left_out)


@pytest.mark.parametrize(("times", "unit"), [
    ([k * 0.02 for k in range(40)], "s"), ([k * 20 for k in range(40)], "ms"),
    ([1.7e12 + k * 20 for k in range(40)], "ms"), ([1.7e12 + k * k * 500 for k in range(40)], ""),
    ([1.7e12 + k * 5000 for k in range(40)], ""), ([float(k * k) for k in range(40)], ""), ([0.0, 0.02, 0.04], "")])
def test_times_close_together_are_a_logs(times: list[float], unit: str, tmp_path: Path) -> None:
    table = any_table(write(tmp_path, "a.csv", "Timestamp,Dist,RPM\n" + "".join(f"{t},3,3000\n" for t in times)))
    found = time_column(table)
    assert ("" if found is None else found.unit) == unit


def test_shots_that_follow_each_other_evenly_are_no_log(tmp_path: Path) -> None:
    for name in ("Time (s)", "time", "Timestamp"):
        rows_ = "".join(f"{(1 if name == 'Timestamp' else 10) * k},3,3000\n" for k in range(40))
        assert time_column(any_table(write(tmp_path, "a.csv", f"{name},Dist,RPM\n{rows_}"))) is None


NEAR = {"Shot": [*range(1, 13)], "Dist (ft)": [8.5 + k for k in range(12)], "Angle": [45 + k / 2 for k in range(12)],
        "RPM": [3300 + 50 * k for k in range(12)], "Result": ["in", "short"] * 6}


@pytest.mark.parametrize(("old", "new", "by", "said"), [
    ("Dist (ft)", "Dist (m)", lambda k, x: 304.8 * x, "distance_m: not Dist (m): 2591 to 5944 are beyond 0 to 100 m; "
     "these look like mm: rename it to Dist (mm)"),
    ("Dist (ft)", "Dist", lambda k, x: 304.8 * x, "are beyond 0 to 100 m; these look like mm: rename it to Dist (mm)"),
    ("Dist (ft)", "DistanceFt", lambda k, x: 30.48 * x, "these look like cm: rename it to Distance (cm)"),
    ("Dist (ft)", "Dist (ft)", lambda k, x: 4300 if k == 5 else x, "mine.csv:7: Dist (ft): 4300 is out of range (0 "
     "to 328.084); the others suggest that it is in mm"),
    ("Dist (ft)", "Dist (ft)", lambda k, x: 4300 if k in (5, 8) else x, "not Dist (ft): 4300 in "),
    ("Dist (ft)", "Dist (ft)", lambda k, x: f"{int(x)} ft 6", "Dist (ft): holds texts, such as '8 ft 6'; write"),
    ("RPM", "Wheel (rad/s)", lambda k, x: x, "motor_rad_s: not Wheel (rad/s): 3300 to 3850 are beyond 20 to 3000 "
     "rad_s; these look like rpm: rename it to Wheel (rpm)"),
    ("RPM", "Flywheel RPM", lambda k, x: x / 60.0, "these look like rev_s: rename it to Flywheel (rev_s)"),
    ("RPM", "Flywheel RPM", lambda k, x: 10 * x if k == 3 else x, "mine.csv:5: Flywheel RPM: 34500 is out of range (0"),
    ("Result", "Result", None, "mine.csv: has no row below its header (Shot, Dist (ft), Angle, RPM, Result); write")])
def test_a_column_that_nearly_was_it_is_named_with_the_likely_unit_and_the_command(
        old: str, new: str, by: Callable[[int, float], object], said: str, tmp_path: Path,
        capsys: pytest.CaptureFixture[str]) -> None:
    table = {new if name == old else name: [by(k, x) for k, x in enumerate(cells)] if by and name == old else cells
             for name, cells in NEAR.items()}
    lines = [",".join(map(str, row)) for row in zip(*table.values(), strict=True)] if by else []
    mine = write(tmp_path, "mine.csv", "\n".join([",".join(table), *lines, ""]))
    rig = write(tmp_path, "rig.toml", RIG)
    assert main(["import", "csv", str(mine), "--guess", "--rig", str(rig), "-o", str(tmp_path / "out")]) == 2
    printed = capsys.readouterr().err.strip()
    assert said in printed
    assert f"run: truearc import csv {mine} --rig {rig} -o {tmp_path}/out --" in printed.splitlines()[-1]


@pytest.mark.parametrize(("times", "said"), [
    ([60 * k for k in range(12)], "t_s: Time (s), in s"), ([-60 * k for k in range(12)], "t_s: Time (s), in s"),
    ([60 * (k - (k == 5)) for k in range(12)], "t_s: Time (s), in s"),
    ([60 * (k - 2 * (k == 5)) for k in range(12)], "t_s: not Time (s): 180 in {}:7 comes after 240; sort the rows"),
    ([7] * 12, "t_s: not Time (s): 7 in {}:3 comes after 7")])
def test_times_that_do_not_rise_are_said(times: list[int], said: str, tmp_path: Path) -> None:
    table = {"Time (s)": times, **{name: cells for name, cells in NEAR.items() if name != "Shot"}}
    mine = write(tmp_path, "mine.csv", "\n".join(",".join(map(str, row)) for row in [
        table, *zip(*table.values(), strict=True)]))
    assert any(said.format(mine) in line for line in guess([mine], write(tmp_path, "rig.toml", RIG)).lines)


@pytest.mark.parametrize(("name", "unit", "new"), [
    ("Dist (ft)", "in", "Dist (in)"), ("distance_m", "ft", "distance_ft"), ("wheel_a_rad_s", "rpm", "wheel_a_rpm"),
    ("DistanceMM", "in", "Distance (in)"), ("Top RPM", "rad_s", "Top (rad_s)"), ("Angle", "rad", "Angle (rad)"),
    ("RPM", "rad_s", "speed (rad_s)"), ("(rpm)", "rad_s", "speed (rad_s)"), ("deg", "rad", "angle (rad)"),
    ("feet", "in", "distance (in)")])
def test_a_heading_in_another_unit_is_read_as_that(name: str, unit: str, new: str) -> None:
    assert in_unit(name, unit) == new and unit_in(new) == unit


# --- workbooks

HEADER = ["Dist (ft)", "Angle", "Flywheel RPM", "Result", "Date"]
DAY = datetime(2026, 3, 4)
CELLS: list[list[Any]] = [["Practice", None, None, None, None], HEADER, [10, 45, 3300.5, "in", DAY],
                          [12, 46, 3400, "short", DAY], [None] * 5, [14, 47.5, 3500, "in", date(2026, 3, 5)],
                          [16, 48, 3600, "in", date(2026, 3, 5)]]


def workbook(folder: Path, *sheets: list[list[Any]]) -> Path:
    book = pytest.importorskip("openpyxl").Workbook()
    book.remove(book.active)
    for cells in sheets:
        sheet = book.create_sheet()
        for row in cells:
            sheet.append(row)
    book.save(folder / "mine.xlsx")
    return folder / "mine.xlsx"


def test_a_workbook_is_read_as_the_same_table_in_csv(tmp_path: Path) -> None:
    rig, mine = write(tmp_path, "rig.toml", RIG), workbook(tmp_path, CELLS)
    assert main(["import", "csv", str(mine), "--guess", "--rig", str(rig), "-o", str(tmp_path / "out")]) == 0
    shots = ta.load_dataset(tmp_path / "out").shots
    assert shots.number("distance_m") == pytest.approx([3.048, 3.6576, 4.2672, 4.8768])
    assert shots.text("session") == ("2026-03-04", "2026-03-04", "2026-03-05", "2026-03-05")
    assert shots.text("outcome") == ("two", "miss", "two", "two")


@pytest.mark.parametrize(("sheets", "message"), [
    ([[]], "mine.xlsx: its first sheet, 'Sheet', is empty; move the table there"),
    ([[[None, None]], CELLS], "is empty; move the table there"),
    ([[HEADER, [10, 45, "=3000+1", "in", "x"]]], "mine.xlsx:2: C2 has a formula without a stored value"),
    ([[HEADER, [10, 45, 3300, "in", "x"], ["~11", 45, 3300, "in", "x"], [12, 45, 3300, "in", "x"]]],
     "mine.xlsx:3: Dist (ft): '~11' is not a number")])
def test_what_a_workbook_lacks_is_named(sheets: list[list[list[Any]]], message: str, tmp_path: Path) -> None:
    with pytest.raises(ta.InputError) as refused:
        ta.import_shots([workbook(tmp_path, *sheets)], rig=write(tmp_path, "rig.toml", RIG))
    assert message in str(refused.value)


def test_a_formulas_stored_value_is_read(tmp_path: Path) -> None:
    """As a spreadsheet program stores it, which openpyxl itself does not."""
    import zipfile
    path = workbook(tmp_path, [HEADER, [10, 45, "=3000+1", "in", "x"], [12, 45, 3300, "short", "x"]])
    with zipfile.ZipFile(path) as old:
        parts = {name: old.read(name) for name in old.namelist()}
    with zipfile.ZipFile(path, "w") as new:
        for name, data in parts.items():
            new.writestr(name, data.replace(b"<f>3000+1</f><v />", b"<f>3000+1</f><v>3001</v>")
                         .replace(b"<f>3000+1</f><v></v>", b"<f>3000+1</f><v>3001</v>"))
    ratio = ta.import_shots([path], rig=write(tmp_path, "rig.toml", RIG)).shots.number("motor_ratio")
    assert ratio[0] == pytest.approx(3001 * np.pi / 30.0 / 600.0)


def test_what_is_no_workbook_and_a_reader_that_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = write(tmp_path, "rig.toml", RIG)
    for data in (b"", b"no workbook", b"PK\x05\x06" + bytes(18)):
        (tmp_path / "mine.xlsx").write_bytes(data)
        with pytest.raises(ta.InputError, match=r"mine\.xlsx: is not a workbook that can be read"):
            ta.import_shots([tmp_path / "mine.xlsx"], rig=rig)
    plain = builtins.__import__

    def lacking(name: str, *args: Any) -> Any:
        if name.startswith("openpyxl"):
            raise ModuleNotFoundError(name=name)
        return plain(name, *args)

    monkeypatch.setattr(builtins, "__import__", lacking)
    with pytest.raises(ta.InputError, match=r"needs openpyxl, .*: pip install 'truearc\[xlsx\]'"):
        ta.import_shots([tmp_path / "mine.xlsx"], rig=rig)
