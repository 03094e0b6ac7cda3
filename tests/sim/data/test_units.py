"""Columns in other units are converted, near misses are named, and spreadsheets of other countries are read."""

import math
from pathlib import Path

import numpy as np
import pytest

import truearc as ta
from truearc.sim.physics.simulate import require

RIG = "[ball]\nmass_kg = 0.14\nradius_m = 0.09\n"
SI = "shot_id,distance_m,hood_deg,wheel_main_rad_s,outcome\na,3.048,57.29577951308232,104.71975511965978,two\n"


def load(home: Path, shots: str, tracks: str = "") -> ta.Dataset:
    home.mkdir(exist_ok=True)
    (home / "rig.toml").write_text(RIG)
    (home / "shots.csv").write_text(shots, encoding="utf-8")
    (home / "tracks.csv").unlink(missing_ok=True)
    if tracks:
        (home / "tracks.csv").write_text(tracks)
    return ta.load_dataset(home)


@pytest.mark.parametrize("shots", [
    SI, "shot_id,distance_ft,hood_rad,wheel_main_rpm,outcome\na,10,1,1000,two\n",
    "shot_id,distance_in,hood_rad,wheel_main_rpm,outcome\na,120,1,1000,2\n",
    "shot_id,distance_cm,hood_rad,wheel_main_rpm,outcome\na,304.8,1,1000, Two\n",
    "shot_id,distance_yd,hood_rad,wheel_main_rpm,outcome\na,3.3333333333,1,1000,two\n",
    " Shot ID ,Distance FT,HOOD_RAD,Wheel_Main_rpm,Outcome\na,10,1,1000,TWO\n",
    "\ufeffshot_id;distance_ft;hood_rad;wheel_main_rpm;outcome\na;10,0;1;1000;two\n",
    'shot_id,distance_ft,hood_rad,wheel_main_rpm,outcome\na,"10,0","1,000000",1000,two\n',
    "shot_id\tdistance_ft\thood_rad\twheel_main_rpm\toutcome\na\t10,00\t1,0\t1000\ttwo\n",
    "shot_id\tdistance_ft\thood_rad\twheel_main_rpm\toutcome\na\t10\t1\t1000\ttwo\n"])
def test_shots_say_the_same_in_other_units(tmp_path: Path, shots: str) -> None:
    read = load(tmp_path, shots).shots
    assert set(read.numbers) == {"distance_m", "hood_deg", "wheel_main_rad_s"} and read.text("outcome") == ("two",)
    assert read.number("distance_m") == pytest.approx([3.048])
    assert read.number("hood_deg") == pytest.approx([math.degrees(1.0)])
    assert read.number("wheel_main_rad_s") == pytest.approx([1000 * 2 * math.pi / 60])


NO_NUMBER = "is not a finite number; decimals have a point, thousands no mark"
OTHER_SPEEDS = ("is not a column that is read; did you mean 'exit_speed_m_s'? Of another unit: exit_speed_ft_s, "
                "exit_speed_in_s, exit_speed_mph, exit_speed_km_h")
MOTORS = "is not read; motor_ratio is the motors' speed by their free speed: divide by"
BEYOND = "is out of range"


@pytest.mark.parametrize(("shots", "said"), [
    *((f"shot_id,distance_m,hood_deg\na,{cells}\n", f"2: distance_m: '{wrong}' {NO_NUMBER}") for cells, wrong in (
        ('"1,234",40', "1,234"), ('"1,234",40.5', "1,234"), ('"1.234,5",40', "1.234,5"))),
    ("shot_id;hood_deg;wheel_main_rad_s\na;40.5;1,234\n", "2: wheel_main_rad_s: '1,234' is not a finite number"),
    *((f"shot_id;distance_m;battery_mv\na;4;{number}\n", f"2: battery_mv: '{number}' {NO_NUMBER}")
      for number in ("12,900", "1,234")),
    *((f"shot_id,{name}\na,1\n", f"1: {name}: {OTHER_SPEEDS}") for name in ("exit_speed_m_ms", "exit_speed_m_us")),
    *((f"shot_id,{name}\na,1\n", f"1: {name}: is not a column that is read; did you mean '{meant}'")
      for name, meant in (
        ("time_s", "t_s"), ("voltage_v", "battery_v"), ("ball", "ball_id"), ("wheel_main_m_s", "wheel_main_rad_s"),
        ("hood", "hood_deg"), ("since_last_shot", "since_last_shot_s"), ("distnce_m", "distance_m"),
        ("Distance", "distance_m"), ("temperature", "temperature_c"), ("outcomes", "outcome"),
        ("hood_angle", "hood_deg"), ("distance_inches", "distance_m"), ("ratio", "motor_ratio"),
        ("result", "outcome"))),
    ("shot_id,distance_rods\na,1\n", "1: distance_rods: is not a column that is read; did you mean 'distance_m'? Of "
     "another unit: distance_mm, distance_cm, distance_in, distance_ft, distance_yd"),
    *((f"shot_id,hood_deg,{name}\na,40,3000\n", f"1: {name}: {MOTORS}") for name in (
        "motor_rpm", "Motor RPM", "motor_percent", "motor_rad_s", "flywheel_speed_rpm", "rpm", "motor_speed")),
    ("shot_id,distance_m,distance_ft\na,3,10\n", "distance_ft: stands for distance_m, which is there already"),
    ("shot_id,hood_deg,wheel_rpm\na,40,3000\n", "1: wheel_rpm: names no wheel of the rig: wheel_<name>_rpm"),
    ("shot_id,distance_m\na,-5\nb,4\n", "2: distance_m: -5 is out of range (0 to 100); it is from the exit to the "
     "target along the floor, and has no sign"),
    ("shot_id,hood_deg,\na,40,\nb,41,7\n", "1: column '' is unnamed, and has '7' in line 3; name it"),
    ("shot_id,,hood_deg\na,,40\n", "1: column '' is unnamed"),
    *((f"shot_id,{header}\na,{cells}\n", said) for header, cells, said in (
        ("distance_cm,hood_deg", "12000,40", f"2: distance_cm: 12000 {BEYOND} (0 to 10000); rename the column to "
         "distance_mm"),
        ("distance_m,hood_rad", "4,30", f"2: hood_rad: 30 {BEYOND} (0 to 1.5708); rename the column to hood_deg"),
        ("distance_m,temperature_f", "4,-460", f"2: temperature_f: -460 {BEYOND} (-130 to 140)"),
        ("distance_in,hood_deg", "far,40", "2: distance_in: 'far' is not a finite number"),
        ("Distance M,hood_deg", "400,40", f"2: Distance M: 400 {BEYOND} (0 to 100); rename the column to distance_mm "
         "or distance_cm or distance_in"),
        ("distance_m,hood_deg", "60,40\nb,70,40\nc,240,41", f"4: distance_m: 240 {BEYOND} (0 to 100); rename the "
         "column to distance_cm or distance_in"),
        ("hood_deg,wheel_main_rad_s", "190,45\nb,200,11", "hood_deg and wheel_main_rad_s look exchanged: exchange"),
        ("hood_deg,wheel_main_rpm", "3000,45\nb,3100,46", "hood_deg and wheel_main_rpm look exchanged: exchange"),
        ("distance_m,Outcome", "4,hit it", "2: Outcome: 'hit it' is none of miss, two, three")))])
def test_what_cannot_be_meant_is_refused_with_what_to_write(tmp_path: Path, shots: str, said: str) -> None:
    with pytest.raises(ta.InputError) as error:
        load(tmp_path, shots)
    assert said in str(error.value)


@pytest.mark.parametrize(("name", "value", "said"), [
    ("temperature_c", 293.15, "rename the column to temperature_k"),
    ("temperature_c", 68.0, "rename the column to temperature_f"),
    ("pressure_pa", 1013.0, "rename .* pressure_hpa"),
    ("battery_v", 12600.0, "rename the column to battery_mv"), ("mass_kg", 142.0, "to mass_g"),
    ("radius_m", 89.0, "rename the column to radius_mm"), ("motor_ratio", 57.9, "divide by 100"),
    ("miss_height_m", 300.0, "to miss_height_mm or miss_height_cm"), ("robot_speed_m_s", 30.0, "")])
def test_numbers_that_cannot_be_name_the_likely_unit(tmp_path: Path, name: str, value: float, said: str) -> None:
    with pytest.raises(ta.InputError, match=rf"shots\.csv:2: {name}: [0-9.]+ is out of range.*{said}"):
        load(tmp_path, f"shot_id,{name}\na,{value}\n")


def test_a_column_with_points_does_not_make_thousands_of_anothers_commas(tmp_path: Path) -> None:
    shots = load(tmp_path, "shot_id;day;distance_m;motor_ratio\na;3.10;4,55;0.5\n").shots
    assert (shots.number("distance_m"), shots.number("motor_ratio")) == (4.55, 0.5)


def test_commas_that_were_read_as_points_are_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    load(tmp_path, 'shot_id,distance_m,hood_deg\na,"3,05","0,579"\n')
    assert capsys.readouterr().err == (f"warning: {tmp_path}/shots.csv: read with commas as decimal points: "
                                       "distance_m, hood_deg\n")


@pytest.mark.parametrize(("header", "factor"), [
    ("t_s,x_mm,y_mm,z_mm", 1e-3), ("t_s,x_cm,y_cm,z_cm", 0.01), ("t_ms,x_in,y_in,z_in", 0.0254),
    ("t_s,x_ft,y_ft,z_ft", 0.3048)])
def test_tracks_as_the_plausibility_checks_advise(tmp_path: Path, header: str, factor: float) -> None:
    tracks = load(tmp_path, SI, f"shot_id,{header}\na,1,10,20,30\na,2,11,21,31\n").tracks
    assert np.array([tracks.x_m, tracks.y_m, tracks.z_m]) == pytest.approx(
        factor * np.array([[10, 11], [20, 21], [30, 31]]))
    assert tracks.t_s == pytest.approx(np.array([1, 2]) * (1e-3 if "t_ms" in header else 1.0))


def test_a_missing_column_is_named_beside_near_misses(tmp_path: Path) -> None:
    with pytest.raises(ta.InputError) as error:
        load(tmp_path, "shot,dist,hood_deg\na,1,45\n")
    lines = str(error.value).replace(" Of another unit", "\0").splitlines()
    assert [line.partition("shots.csv:1: ")[2].partition("\0")[0] for line in lines] == [
        "shot: is not a column that is read; did you mean 'shot_id'?",
        "dist: is not a column that is read; did you mean 'distance_m'?", "column shot_id is missing"]


def test_covariates_keep_their_names(tmp_path: Path) -> None:
    numbers = load(tmp_path, "shot_id,motor_ratio,Humidity,motor_rpm,coating_g\na,0.4,0.5,3000,2\n").shots.numbers
    assert set(numbers) == {"motor_ratio", "Humidity", "motor_rpm", "coating_g"}


def test_each_word_that_is_no_outcome_is_told_once_with_what_to_write(tmp_path: Path) -> None:
    with pytest.raises(ta.InputError) as raised:
        load(tmp_path, "shot_id,outcome\na,1\nb,0\nc,1\nd,1\ne,lost\n")
    assert [line.partition("csv:")[2] for line in str(raised.value).splitlines()] == [
        "2: outcome: '1' is none of miss, two, three, hit; if it says that it went in, write hit; here and in 2 more "
        "rows",
        "3: outcome: '0' is none of miss, two, three, hit; if it says that it missed, write miss",
        "6: outcome: 'lost' is none of miss, two, three, hit"]


def test_a_column_in_another_unit_is_one_problem_and_a_few_bad_cells_are_each_one(tmp_path: Path) -> None:
    with pytest.raises(ta.InputError) as raised:
        load(tmp_path, "shot_id,distance_m,hood_deg\na,400,91\nb,3,92\nc,500,93\nd,450,40\ne,,41\nf,,42\ng,,43\n")
    assert [line.partition("shots.csv:")[2].partition(" is out")[0] for line in str(raised.value).splitlines()] == [
        "2: distance_m: 400", "2: hood_deg: 91", "3: hood_deg: 92", "4: hood_deg: 93"]
    assert "or distance_in; here and in 2 more rows" in str(raised.value)


@pytest.mark.parametrize(("name", "value", "read", "is_"), [
    ("temperature_k", 293.15, "temperature_c", 20.0), ("temperature_f", 68.0, "temperature_c", 20.0),
    ("pressure_hpa", 1013.0, "pressure_pa", 101300.0), ("battery_mv", 12600.0, "battery_v", 12.6),
    ("mass_g", 142.0, "mass_kg", 0.142), ("radius_mm", 89.0, "radius_m", 0.089),
    ("wheel_main_rps", 30.0, "wheel_main_rad_s", 60.0 * math.pi), ("exit_spin_rps", 30.0, "exit_spin_rev_s", 30.0),
    ("exit_speed_ft_s", 30.0, "exit_speed_m_s", 9.144), ("since_last_shot_ms", 30.0, "since_last_shot_s", 0.03)])
def test_the_advised_columns_are_read(tmp_path: Path, name: str, value: float, read: str, is_: float) -> None:
    assert load(tmp_path, f"shot_id,{name}\na,{value}\n").shots.number(read) == pytest.approx([is_])


@pytest.mark.parametrize("shots", [
    "shot_id,hood_deg,outcome,\na,40,two,\n", "shot_id,hood_deg,outcome, ,\na,40,two, ,\n,,,,\n",
    "shot_id,hood_deg,outcome\na,40,two,\n", "shot_id;hood_deg;outcome;\na;40,0;two;\n"])
def test_empty_columns_behind_the_last_are_skipped(tmp_path: Path, shots: str) -> None:
    read = load(tmp_path, shots).shots
    assert (read.shot_id, read.text("outcome")) == (("a",), ("two",)) and set(read.numbers) == {"hood_deg"}


def test_the_speed_of_a_wheel_that_the_rig_lacks_is_refused(tmp_path: Path) -> None:
    wheel = '[[launcher.wheel]]\nname = "lower"\nradius_m = 0.05\ngear = 1.0\nclock_deg = 180.0\n'
    shots = {"shot_id": ["a"], "motor_ratio": [0.5], "wheel_low_rad_s": [300.0]}
    (tmp_path / "rig.toml").write_text(RIG + wheel)
    rig = ta.load_rig(tmp_path / "rig.toml")
    with pytest.raises(ta.InputError, match=r"wheel_low_rad_s: rig\.toml has no such wheel; it has wheel_lower_rad_s"):
        ta.dataset(shots, rig=rig)
    both = ta.dataset(shots | {"wheel_lower_rad_s": [300.0]}, rig=rig)
    assert "wheel_low_rad_s" in both.shots.numbers                 # of the feeder, say: a covariate


def test_a_missing_cell_is_named_by_the_files_own_column(tmp_path: Path) -> None:
    shots = load(tmp_path, "shot_id,distance_cm,hood_deg\na,400,40\nb,,41\n").shots
    with pytest.raises(ta.InputError, match=r"shots\.csv: shots b: distance_cm is needed and missing"):
        require(shots, "distance_m")
