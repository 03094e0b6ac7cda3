"""Tables with a row per shot, under their own names or other programs' maps, become shots; what they lack is said."""

import math
import re
import tempfile
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec import structs

import truearc as ta
import truearc.cli.main as truearc
from truearc.cli.common import SHIPPED
from truearc.cli.main import main
from truearc.robot.config.schema import load_config
from truearc.robot.config.shot_map import as_signal, load_map
from truearc.robot.config.units import unit_in
from truearc.sim.data.import_shots import guess
from truearc.sim.printed import MOST, left_out_lines

RIG = """
[ball]
mass_kg = 0.14
radius_m = 0.0889
[launcher]
release_height_m = 0.75
free_speed_rad_s = 600.0
[[launcher.wheel]]
name = "main"
radius_m = 0.05
gear = 1.0
clock_deg = 180.0
[target]
centre_height_m = 2.44
three_half_height_m = 0.0
two_half_height_m = 0.35
"""
HEADER = "Shot,Dist (ft),Hood angle,Flywheel RPM,Result,Robot"
ROWS = ["1,10,45,3300,in,old", "2,10,45,3200,short,old", "3,12,46,3500,long,old", "4,12,46,3450,Rim out,old",
        "5,14,47,3600,left,old", "6,14,47,3650,made,old", "7,16,48,3900,missed low,new", "8,16,48,3950,good,new",
        "9,18,49,4100,over,new", "10,18,49,4000,redo,new", "11,11,45,3400,yes,new", "12,13,46,3550,no,new"]
RPM = 0.10471975511965977                              # rad/s of a revolution per minute


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    path = tmp_path / "rig.toml"
    path.write_text(RIG)
    return path


def sheet(folder: Path, *lines: str, name: str = "mine.csv") -> Path:
    path = folder / name
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
    return path


def test_a_students_spreadsheet_is_imported_and_checked(rig, tmp_path, capsys):
    out = tmp_path / "out"
    mine = sheet(tmp_path, HEADER, *ROWS)
    assert main(["import", "csv", str(mine), "--guess", "--rig", str(rig), "-o", str(out)]) == 0
    assert capsys.readouterr().out.splitlines() == [
        f"guessed from the names, units and numbers of {mine}; make sure of it:",
        "  distance_m: Dist (ft), in ft",
        "  hood_deg: Hood angle, whose unit is not stated: taken as deg",
        "  motor_rad_s: Flywheel RPM, in rpm",
        "  t_s: Shot: the order of the shots",
        "  shot_id: Shot",
        "  outcome: Result: in = hit, short = miss-low, long = miss-high, rim out = miss, left = miss-left, "
        "made = hit, missed low = miss-low, good = hit, over = miss-high, redo = rejected, yes = hit, no = miss",
        "  not used: Robot",
        f"{out}: 11 shots, 0 track samples",
        f"left out: {mine}:11: rejected"]
    shots = ta.load_dataset(out).shots
    assert shots.shot_id == ("1", "2", "3", "4", "5", "6", "7", "8", "9", "11", "12")
    assert shots.text("outcome") == ("two", "miss", "miss", "miss", "miss", "two", "miss", "two", "miss", "two", "miss")
    assert shots.text("side") == ("", "low", "high", "", "left", "", "low", "", "high", "", "")
    assert shots.number("distance_m")[:3] == pytest.approx([3.048, 3.048, 3.6576])
    assert shots.number("hood_deg")[:3].tolist() == [45.0, 45.0, 46.0]
    assert shots.number("motor_ratio")[:2] == pytest.approx([3300 * RPM / 600.0, 3200 * RPM / 600.0])
    assert shots.number("t_s").tolist() == [1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 12]
    assert main(["check", str(out)]) == 0
    again = ta.import_shots([mine], rig=rig, shot_map=out / "shots.toml")                   # what was written is a map
    assert again.shots.text("outcome") == shots.text("outcome")


def test_a_word_that_is_not_known_is_asked_about(rig, tmp_path, capsys):
    mine = sheet(tmp_path, HEADER, *ROWS, "13,13,46,3550,bounce,new", "14,13,46,3550,,new", "15,13,46,3550,bounce,new")
    words = ["import", "csv", str(mine), "--rig", str(rig), "-o", str(tmp_path / "out")]
    assert main([*words, "--guess"]) == 2
    out, err = capsys.readouterr()
    assert "outcome: Result: empty (once): left out\n" in out and not (tmp_path / "out").exists()
    assert "is not certain of 'bounce' (2 times). Proposed: in = hit, short = miss-low, " in err and "--outcomes" in err
    assert main([*words, "--guess", "--outcomes", "bounce=miss"]) == 0
    assert f"left out: {mine}:15: no outcome\n" in capsys.readouterr().out
    assert len(ta.load_dataset(tmp_path / "out").shots) == 13


def test_columns_beside_those_that_are_needed(rig: Path, tmp_path: Path) -> None:
    mine = sheet(tmp_path, "Practice, Monday,,,,,,,,,,", "#,Day,Range [in],Pitch (deg),Exit speed,"
                 "Motor speed (rps),Made,Ball,Temp (F),Battery,Battery voltage,Side",
                 "1,Mon,120,45,9,55,1,A,50,1,12.5,",
                 "2,Mon,120,45,9,54,0,B,50,2,12.25,low", "4,Tue,100,46,9,56,0,A,68,1,12.5,high",
                 "5,Tue,100,46,9,57,1,B,68,2,12.25,")
    found = guess([mine], ta.load_rig(rig))
    assert found.lines[-1] == "not used: Exit speed, Battery"
    assert {column: as_signal(said).key for column, said in found.map.columns.items()} == {
        "side": "Side", "distance_m": "Range [in]", "hood_deg": "Pitch (deg)", "motor_rad_s": "Motor speed (rps)",
        "battery_v": "Battery voltage", "temperature_c": "Temp (F)", "ball_id": "Ball", "session": "Day", "t_s": "#",
        "shot_id": "#"}
    dataset = ta.import_shots([mine], rig=rig)
    shots = dataset.shots
    assert "sides: 1 low, 1 high" in dataset.lines()
    assert shots.number("distance_m") == pytest.approx([3.048, 3.048, 2.54, 2.54])
    assert shots.number("motor_ratio")[0] == pytest.approx(55 * 6.283185307179586 / 600.0)
    assert shots.number("temperature_c") == pytest.approx([10.0, 10.0, 20.0, 20.0])
    assert shots.number("battery_v").tolist() == [12.5, 12.25, 12.5, 12.25]
    assert shots.text("session") == ("Mon", "Mon", "Tue", "Tue") and shots.text("ball_id") == ("A", "B", "A", "B")
    assert shots.text("outcome") == ("two", "miss", "miss", "two") and shots.text("side") == ("", "low", "high", "")


def test_day_and_driver_beside_a_session_are_groups_of_shots(rig: Path, tmp_path: Path) -> None:
    rows = [f"{k},{9 + k},45,3300,{'in' if k % 2 else 'short'},{k // 3},{k // 6},{'AB'[k % 2]}" for k in range(12)]
    mine = sheet(tmp_path, "Shot,Dist (ft),Hood angle,RPM,Result,Session,Day,Driver", *rows)
    shots = ta.import_shots([mine], rig=rig).shots
    assert [len(set(shots.text(name))) for name in ("session", "day", "fired_by")] == [4, 2, 2]


@pytest.mark.parametrize(("name", "value"), [("Hood from vertical (deg)", 30.0), ("Hood from vertical [rad]", 0.5236)])
def test_an_angle_from_the_vertical_is_read_as_its_complement(name, value, rig, tmp_path):
    rows = [f"{k},{9 + k},{value * (1.0 - 0.01 * k)},3300,{'in' if k % 2 else 'short'},old" for k in range(12)]
    mine = sheet(tmp_path, HEADER.replace("Hood angle", name), *rows)
    found = guess([mine], ta.load_rig(rig))
    assert any("hood_deg" in line and "from the vertical" in line for line in found.lines)
    hood_deg = ta.import_shots([mine], rig=rig).shots.number("hood_deg")
    assert hood_deg == pytest.approx([60.0 + 0.3 * k for k in range(12)], abs=1e-3)
    again = tmp_path / "shots.toml"
    again.write_text(found.to_toml())
    assert ta.import_shots([mine], rig=rig, shot_map=again).shots.number("hood_deg") == pytest.approx(hood_deg)


def test_semicolons_a_form_with_clock_times_and_a_header_of_two_lines(rig, tmp_path, capsys):
    mine = sheet(tmp_path, 'Timestamp;"Distance', '(m)";Angle;RPM;What happened', "3/4/2026 10:12:33;3,5;45;3000;in",
                 "3/4/2026 10:13:33;3,5;45,5;3000;short")
    shots = ta.import_shots([mine], rig=rig).shots
    assert shots.number("distance_m").tolist() == [3.5, 3.5] and shots.number("hood_deg").tolist() == [45.0, 45.5]
    assert shots.text("outcome") == ("two", "miss") and shots.text("side") == ("", "low")
    assert capsys.readouterr().err.count("read with semicolons between cells") == 1        # although it is read twice


def test_shots_of_two_days_are_told_apart_and_the_words_of_both_count(rig: Path, tmp_path: Path) -> None:
    files = [sheet(tmp_path, HEADER, *rows, name=name) for name, rows in (("mon.csv", ROWS[:2]), ("tue.csv", [
        "1,12,46,3500,long,old", "2,12,46,3500,in,old"]))]
    shots = ta.import_shots(files, rig=rig).shots
    assert shots.shot_id == ("mon-0000", "mon-0001", "tue-0000", "tue-0001")
    assert shots.text("session") == ("mon", "mon", "tue", "tue") and shots.text("side") == ("", "low", "high", "")


def test_what_is_missing_is_said_with_what_was_recognised(rig: Path, tmp_path: Path) -> None:
    mine = sheet(tmp_path, "Shot,Dist (ft),Tilt,Power,Result", "1,10,45,0.5,in", "2,11,46,0.6,out")
    with pytest.raises(ta.InputError) as refused:
        guess([mine], ta.load_rig(rig))
    assert str(refused.value).splitlines() == [
        f"{mine}: no column's name, unit and numbers look like hood_deg, motor_rad_s; write a map by hand: "
        "docs/how-to/importing.md",
        "recognised: distance_m: Dist (ft), in ft", "columns with numbers:", "  Dist (ft): 10 to 11 ft",
        "  Power: 0.5 to 0.6", "  Shot: 1 to 2", "  Tilt: 45 to 46"]


@pytest.mark.parametrize(("lines", "said"), [
    (["Dist (ft),Angle,RPM", "10,45,3000", "~11,45,3000", "12,45,3000"],
     "mine.csv:3: Dist (ft): '~11' is not a number"),
    (["Title", "Dist (ft),Angle,RPM", "10,45,3000", "10,45"], "mine.csv:4: 2 cells where the header has 3"),
    (["Title", "Dist (ft),hood_deg,RPM", "10,45,3000", "10,145,3000"], "mine.csv:4: hood_deg: 145 is out of range"),
    (["Time (s),Distance,Angle,RPM", *(f"{k / 50},3,45,3000" for k in range(30))], "no shot was found"),
    ([], "header is missing"), (["\n"], "header is missing")])
def test_a_wrong_cell_is_named_by_line_and_a_log_is_no_table_of_shots(lines, said, rig, tmp_path):
    with pytest.raises(ta.InputError) as refused:
        ta.import_shots([sheet(tmp_path, *lines)], rig=rig)
    assert said in str(refused.value)


@pytest.mark.parametrize("column", ["Windy", "Spun up", "Side", "Miss side"])
def test_yes_and_no_and_sides_are_no_outcomes(column: str, rig: Path, tmp_path: Path) -> None:
    words = ("high", "low") if "ide" in column else ("yes", "no")
    mine = sheet(tmp_path, f"Dist (ft),Angle,RPM,{column}", *(f"10,45,3000,{word}" for word in words))
    found = guess([mine], ta.load_rig(rig))
    assert not found.map.outcome.key and any(line.startswith("outcome: none found") for line in found.lines)


@pytest.mark.parametrize(("name", "cells", "said"), [
    ("Result", "2 3 miss", "outcome: Result: 2 = two, 3 = three"), ("Result", "1 0 miss", "outcome: Result: 1 = hit"),
    ("Result", "0 2 3 n/a", "0 = miss, 2 = two, 3 = three, n/a = rejected"), ("Points", "0 2 3", "outcome: Points: 0"),
    ("Notes", "2 3 short", "outcome: Notes: 2 = two, 3 = three, short = miss-low"),
    ("Ball in?", "Y N", "outcome: Ball in?: y = hit, n = miss"), ("In range?", "Y N", "outcome: none found"),
    ("Score", "5 0 10 5", "outcome: not Score: '5' and the like are no outcomes; write words, or 0, 2 and")])
def test_outcomes_in_numbers_and_words(name: str, cells: str, said: str, rig: Path, tmp_path: Path) -> None:
    mine = sheet(tmp_path, f"Dist (ft),Angle,RPM,{name}", *(f"10,45,3000,{cell}" for cell in cells.split() * 3))
    assert any(said in line for line in guess([mine], rig).lines)


def test_words_beside_points_are_proposed_by_these_and_letters_are_asked_about(rig: Path, tmp_path: Path) -> None:
    rig.write_text(RIG.replace("three_half_height_m = 0.0", "three_half_height_m = 0.1"))
    words = {"3 pts": "three", "2pts": "two", "made 2": "two", "t": "?", "x": "?", "?": "rejected", "fell off": "miss"}
    mine = sheet(tmp_path, "Dist (ft),Angle,RPM,Result", *(f"10,45,3000,{word}" for word in words))
    assert guess([mine], rig).proposed == words


@pytest.mark.parametrize(("name", "unit"), [
    ("Dist (ft)", "ft"), ("Dist [in.]", "in"), ("dist_ft", "ft"), ("Dist ft", "ft"), ("dist_cm", "cm"),
    ("Angle (°)", "deg"), ("Hood angle", ""), ("Wheel RPM (top)", "rpm"), ("Speed (rad/s)", "rad_s"),
    ("Temp (°F)", "f"), ("Dist (yards)", "yd"), ("Notes (see below)", ""), ("Distance (hub)", ""), ("Time (s) ", "s"),
    ("x)", ""), ("", ""), ("ExitSpeedMS", "m_s"), ("exit_velocity_ms", "m_s"), ("FlightTimeMS", "ms"),
    ("VelocityMPS", "m_s"), ("exitVelocityFps", "ft_s"), ("ExitSpeedFtPerSec", "ft_s"), ("Speed in m/s", "m_s"),
    ("ExitSpeedKPH", "km_h"), ("Time in s", "s"), ("HoodAngleRads", "rad"), ("VelocityRads", "rad_s"),
    ("flywheel_rad_per_sec", "rad_s"), ("shootervelocityradpersec", "rad_s"), ("WheelRotPerSec", "rps"),
    ("/Shooter/VelocityRPM/value", "rpm"), ("TempC", "c"),
    ("ActualRPS", "rps"), ("DistanceMM", "mm"), ("distanceIn", "in"), ("DistanceFt", "ft"),
    ("Begin", ""), ("Alarm", ""), ("BATTERYV", "")])
def test_units_in_headers(name: str, unit: str) -> None:
    assert unit_in(name) == unit


NAMES = st.sampled_from(["Dist (ft)", "distance_m", "Angle", "hood_rad", "RPM", "motor_ratio", "Wheel (rps)", "Result",
                         "Shot", "#2", "Time (s)", "Timestamp", "side", "Day", "Temp", "Battery", "shot_id", "outcome"])
CELLS = st.sampled_from(["", "1", "2", "10", "45", "3000", "-5", "nan", "1e999", "in", "short", "3,5", "true", "#"])


@settings(deadline=None, max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_table_is_read_or_refused(data: st.DataObject, rig: Path) -> None:
    mark = data.draw(st.sampled_from(",;\t"))
    header = data.draw(st.lists(NAMES | st.text(min_size=1, max_size=6), min_size=1, max_size=7, unique=True))
    needed = data.draw(st.sampled_from([[], ["Dist", "Hood", "Motor RPM"]]))
    rows = data.draw(st.lists(st.lists(CELLS | st.text(max_size=4), min_size=len(header), max_size=len(header)),
                              max_size=5))
    text = "\n".join(mark.join([*line, *more]) for line, more in
                     [(header, needed), *((row, ["3", "45", "3000"][:len(needed)]) for row in rows)])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mine.csv"
        path.write_bytes(text.encode("utf-8", "replace"))
        try:
            found = guess([path], ta.load_rig(rig))
            tomllib.loads(found.to_toml())
            ta.import_shots([path], rig=rig, shot_map=found.map)
        except ta.InputError:
            pass


ROBOT = load_config(SHIPPED).rig
HIT_OR_MISS = structs.replace(ROBOT, target=structs.replace(ROBOT.target, three_half_height_m=0.0))
COLLECTED = "distance_m,velocity_rps,hood_angle_deg,timestamp,successful,notes\n"


def test_2928s_collector(tmp_path: Path) -> None:
    """The header and the form of numbers are those of the team's public file; the numbers are not."""
    (tmp_path / "monday.csv").write_text(
        f"{COLLECTED}2.000,55.000,48.000,1771719211810,true,\n3.500,62.500,44.000,1771719214249,false,short\n")
    shots = ta.import_shots([tmp_path / "monday.csv"], rig=HIT_OR_MISS, shot_map="viking-2928").shots
    assert shots.text("outcome") == ("two", "miss") and shots.number("distance_m").tolist() == [2.0, 3.5]
    free = ROBOT.launcher.free_speed_rad_s or math.nan
    assert shots.number("motor_ratio") == pytest.approx([55.0 * 2.0 * math.pi / free, 62.5 * 2.0 * math.pi / free])
    assert np.diff(shots.number("t_s")) == pytest.approx([2.439])


@pytest.mark.parametrize(("name", "text"), [
    ("tracker", "ball\nt\tx\ty\n0.000\t0.10\t1.00\n0.033\t0.35\t1.12\n0.067\t0.61\t1.22\n"),
    ("tracker", "#multi:\n\tball\t\nt\tx\ty\n0.000\t0.10\t1.00\n0.033\t0.35\t1.12\n0.067\t0.61\t1.22\n"),
    ("kinovea", "Time (ms);ball/x;ball/y\n0,0;0,10;1,00\n33,0;0,35;1,12\n67,0;0,61;1,22\n"),
    ("kinovea", '"Time (ms)","ball/x","ball/y"\n0.0,0.10,1.00\n33.0,0.35,1.12\n67.0,0.61,1.22\n')])
def test_hand_made_tracks(name: str, text: str, tmp_path: Path) -> None:
    for shot in ("a", "b"):
        (tmp_path / f"{shot}.txt").write_text(text)
    found = ta.import_shots([tmp_path / "a.txt", tmp_path / "b.txt"], rig=ROBOT, shot_map=name)
    assert found.shots.shot_id == ("a", "b") and found.tracks is not None
    np.testing.assert_allclose(found.tracks.t_s, [0.0, 0.033, 0.067] * 2)
    np.testing.assert_allclose(found.tracks.x_m, [0.10, 0.35, 0.61] * 2)
    np.testing.assert_allclose(found.tracks.z_m, [1.00, 1.12, 1.22] * 2)
    assert not found.tracks.y_m.any()


@pytest.mark.parametrize(("text", "said"), [
    (f"{COLLECTED}2,55,48,1,maybe,\n", r"a\.csv:2: successful: 'maybe' is none of the map's values"),
    ("distance_m,hood\n2,48\n", r"a\.csv:1: there is no line with the columns distance_m, hood_angle_deg")])
def test_words_and_columns_that_a_map_does_not_know_are_named(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(ta.InputError, match=said):
        ta.import_shots([tmp_path / "a.csv"], rig=ROBOT, shot_map="viking-2928")


def test_a_key_that_two_sensors_share_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "shots.toml"
    path.write_text('schema = "truearc.shot-map/1"\n[columns]\ndistance_m = "/Battery"\nhood_deg = "/Hood"\n'
                    'battery_v = { key = "/Battery", unit = "V" }\n')
    with pytest.raises(ta.InputError, match=r"columns\.distance_m and columns\.battery_v have the same key, /Battery"):
        load_map(path)


def test_two_files_of_one_name_are_refused(tmp_path: Path) -> None:
    for folder in ("x", "y"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "a.txt").write_text("t\tx\ty\n0\t0\t1\n1\t1\t1\n")
    with pytest.raises(ta.InputError, match="two files are called a"):
        ta.import_shots([tmp_path / "x" / "a.txt", tmp_path / "y" / "a.txt"], rig=ROBOT, shot_map="tracker")


def test_of_many_left_out_a_few_are_named_and_the_others_counted() -> None:
    assert left_out_lines(["a", "b"]) == ["left out: a", "left out: b"]
    many = left_out_lines([f"row {k}" for k in range(MOST + 92)])
    assert many[MOST - 1:] == [f"left out: row {MOST - 1}", "left out: 92 more"]


ROOT = Path(__file__).parents[3]
SPREADSHEET = ROOT / "examples/spreadsheet"


LAUNCHER = (ROOT / "robot/launcher.toml").read_text(encoding="utf-8")


@pytest.mark.parametrize(("load", "text", "said"), [
    (ta.load_rig, '[target]\n[ball]\nradius_m = 0.1\n[[launcher.wheel]]\nname = "a"\nradius_m = 0.05\ngear = 1.0\n'
     'clock_deg = 0.0\n[[launcher.wheel]]\nname = "b"\nclock_deg = 180.0\n',
     ": keys are missing: ball.mass_kg, launcher.wheel.radius_m, launcher.wheel.gear, target.centre_height_m"),
    (load_config, re.sub(r"(?m)^(fx_px|kp|repeats|mass_kg).*\n", "", LAUNCHER),
     ": keys are missing: flywheel.pid.kp, hood.pid.kp, camera.fx_px, collect.repeats, rig.ball.mass_kg, "
     "identify.flywheel.repeats, identify.hood.repeats"),
    (load_config, LAUNCHER.replace('driver = "odrive"', 'driver = "spark"', 1).replace("node = 4\n", ""),
     ":17: axes.flywheels[0].node: unknown key; keys are missing: axes.flywheels.device, axes.flywheels.has_endstop, "
     "axes.flywheels.stall_torque_nm, axes.flywheels.free_speed_rad_s, axes.flywheels.rated_v, axes.feeder.node"),
    (load_config, LAUNCHER.replace("[rig.ball]", "[rig.bal]"),
     ": keys are missing: rig.ball.mass_kg, rig.ball.radius_m; [rig.bal] is unknown; did you mean ball")],
    ids=["rig", "launcher", "axes by their drivers", "mistyped table"])
def test_all_missing_keys_are_named(load: Callable[[Path], object], text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "stated.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ta.InputError) as error:
        load(path)
    assert str(error.value).startswith(f"{path}{said}")


def test_all_missing_columns_of_tracks_are_named() -> None:
    with pytest.raises(ta.InputError, match="tracks: columns t_s, y_m are missing"):
        ta.dataset({"shot_id": ["a"]}, rig={"ball": {"mass_kg": 0.14, "radius_m": 0.09}},
                   tracks={"shot_id": ["a"], "x_m": [0.0], "z_m": [1.0]})


def copy_shots(folder: Path, count: int, columns: int) -> Path:
    """The first shots and columns of the example."""
    folder.mkdir()
    (folder / "rig.toml").write_bytes((SPREADSHEET / "rig.toml").read_bytes())
    rows = (SPREADSHEET / "shots.csv").read_text(encoding="utf-8").splitlines()[:count + 1]
    kept = [row.split(",") for row in rows]
    (folder / "shots.csv").write_text("\n".join(",".join([*row[:columns], row[4]]) for row in kept), encoding="utf-8")
    return folder


def test_all_that_shots_lack_for_a_fit_is_named(tmp_path: Path) -> None:
    with pytest.raises(ta.InputError) as error:
        ta.fit(ta.load_dataset(copy_shots(tmp_path / "few", 20, 1)))
    for name in ("distance_m", "hood_deg or exit_deg", "motor_ratio"):
        assert name in str(error.value)


def test_six_shots_are_warned_of(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    few = copy_shots(tmp_path / "few", 6, 4)
    assert "warning: 6 shots are too few to judge a simulation by" in str(ta.fit(ta.load_dataset(few)))
    assert truearc.main(["check", str(few), "--quiet"]) == 0
    assert "6 shots are too few to judge a simulation by; 10 at least; of a season" in capsys.readouterr().out
    assert truearc.main(["discover", str(few), "--quiet"]) == 2
    assert "6 shots are too few" in capsys.readouterr().err
