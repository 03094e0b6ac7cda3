"""Every kind of bad row or file is named with its place; times.csv is read strictly and written back exactly."""

import string
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import truearc as ta
from tests.sim.data.files import GOOD, HEADER, RIG, write
from truearc.robot.config.rig_spec import Air, Ball, LauncherFacts, Rig
from truearc.sim.check.check import check_plausible
from truearc.sim.data.dataset import Dataset, Shots, Times, join_datasets
from truearc.sim.data.files import hash_dataset, load_dataset

BAD_ROWS = {
    "b,nan,50,0.5,two,,,": "3: distance_m: 'nan' is not a finite number",
    "b,3,50,1e999,two,,,": "3: motor_ratio: '1e999' is not a finite number",
    "b,-1,50,0.5,two,,,": "3: distance_m: -1 is out of range",
    "b,3,120,0.5,two,,,": "3: hood_deg: 120 is out of range (0 to 90)",
    "b,3,50,1_0,two,,,": "3: motor_ratio: '1_0' is not a finite number",
    "b,3,50,0.5,four,,,": "3: outcome: 'four' is none of miss, two, three",
    "b,3,50,0.5,miss,up,,": "3: side: 'up' is none of low, high, left, right",
    "b,3,50,0.5,three,low,,": "3: side: outcome three cannot have the miss side 'low'",
    "b,3,50,0.5,two,,,warm": "3: temperature_c: 'warm' is not a finite number",
    "a,3,50,0.5,two,,,": "3: shot_id: 'a' stands already in",
    ",3,50,0.5,two,,,": "3: shot_id: is missing",
    "b,3,50,0.5,two": "3: 5 cells where the header has 8",
    "b,3,50,0.5,two,,,,9": "3: 9 cells where the header has 8"}
SOUND, TRACK, TRACE = f"{HEADER}\n{GOOD}\n", "shot_id,t_s,x_m,y_m,z_m\na,0,0,0,1\n", "shot_id,t_s,signal,value\n"


@pytest.mark.parametrize(("shots", "more", "message"), [
    *((f"{SOUND}{row}\n", {}, f"shots.csv:{message}") for row, message in BAD_ROWS.items()),
    ("", {}, "shots.csv:1: the header is missing"),
    ("distance_m\n3\n", {}, "shots.csv:1: column shot_id is missing"),
    ("shot_id,a,a\nx,1,2\n", {}, "shots.csv:1: column 'a' stands twice"),
    ("shot_id,\nx,1\n", {}, "shots.csv:1: column '' is unnamed"),
    ('shot_id,a\nx,"1\n', {}, "shots.csv:2: unexpected end of data"),
    (SOUND, {"tracks": f"{TRACK}z,0,0,0,0\n"}, "tracks.csv:3: shot_id: 'z' is not among the shots"),
    (SOUND, {"tracks": f"{TRACK}a,0,0,0,0\n"}, "tracks.csv:3: t_s: 0 does not follow 0 of the same shot"),
    (SOUND, {"tracks": f"{TRACK}a,1,,0,0\n"}, "tracks.csv:3: x_m: is missing"),
    (SOUND, {"tracks": f"{TRACK}a,1,0,0,inf\n"}, "tracks.csv:3: z_m: 'inf' is not a finite number"),
    (SOUND, {"traces": f"{TRACE}a,0,,1\n"}, "traces.csv:2: signal: is missing"),
    (SOUND, {"traces": f"{TRACE}a,0,battery_v,full\n"}, "traces.csv:2: value: 'full' is not a finite number")])
def test_a_bad_row_or_file_is_named(tmp_path, shots, more, message):
    with pytest.raises(ta.InputError) as error:
        load_dataset(write(tmp_path, shots, **more))
    assert message in str(error.value) and len(str(error.value).splitlines()) == 1


def test_a_blank_line_and_a_cell_of_two_lines_do_not_shift_the_count(tmp_path):
    write(tmp_path, f'{HEADER}\n{GOOD}\n\nb,3,50,0.5,two,,"day\n2",20\nc,3,99,0.5,two,,,\n')
    with pytest.raises(ta.InputError, match=r"shots\.csv:6: hood_deg"):
        load_dataset(tmp_path)


def test_all_problems_are_listed_up_to_twenty(tmp_path):
    rows = "\n".join(f"r{number},far" for number in range(23))
    write(tmp_path, f"{HEADER}\nr,3,50,0.5,two,,,\n{rows}\n", tracks="shot_id,t_s,x_m,y_m,z_m\nr,0,0,0,\n")
    with pytest.raises(ta.InputError) as error:
        load_dataset(tmp_path)
    lines = str(error.value).splitlines()
    assert len(lines) == 21
    assert "shots.csv:22: 2 cells where the header has 8" in lines[19]
    assert lines[20] == "... and 4 more problems (24 in all)"


def test_the_same_fault_of_many_cells_is_said_once(tmp_path):
    rows = "\n".join(f"r{number},3.2m,50,0.5,two,,," for number in range(23))
    write(tmp_path, f"{HEADER}\n{rows}\n")
    with pytest.raises(ta.InputError, match=r"shots\.csv:2: distance_m: '3.2m' is not a finite number; write digits "
                                         r"alone, and the unit in the column's name; .*; here and in 22 more rows$"):
        load_dataset(tmp_path)


def test_bytes_that_are_no_text_are_named(tmp_path):
    write(tmp_path, "")
    (tmp_path / "shots.csv").write_bytes(b"shot_id,session\na,x\nb,\xff\n")
    with pytest.raises(ta.InputError, match=r"shots\.csv:3: not UTF-8"):
        load_dataset(tmp_path)


def test_missing_files_are_named(tmp_path):
    with pytest.raises(ta.InputError, match="no such directory"):
        load_dataset(tmp_path / "nowhere")
    with pytest.raises(ta.InputError, match=r"rig\.toml"):
        load_dataset(tmp_path)
    (tmp_path / "rig.toml").write_text(RIG, encoding="utf-8")
    with pytest.raises(ta.InputError, match=r"neither shots\.csv nor shots\.parquet"):
        load_dataset(tmp_path)


@settings(max_examples=150, deadline=None)
@given(st.text(alphabet=string.printable + "é\x00\ufeff", max_size=200))
def test_any_text_is_read_or_refused(tmp_path_factory, text):
    home = tmp_path_factory.mktemp("any")
    write(home, "")
    (home / "shots.csv").write_bytes(text.encode())
    try:
        shots = load_dataset(home).shots
    except ta.InputError as error:
        assert "shots.csv" in str(error)
    else:
        assert all(np.isfinite(column[~np.isnan(column)]).all() for column in shots.numbers.values())
        assert len(set(shots.shot_id)) == len(shots)


TOWER = Rig(Ball(0.14, 0.0889), LauncherFacts(release_height_m=20.0), air=Air(1.2))
IDS = ("a", "b", "c")
TIMES = Times(np.array([0, 0, 1, 2]), np.array([1.02, 1.45, 1.01, 2.03]), np.array([15.0, 10.0, 15.0, 0.0]),
              np.array([0.02, 0.02, 0.01, 0.02]))


def dropped(times: Times = TIMES) -> Dataset:
    return Dataset("drops", TOWER, Shots(IDS, {}, {}), times=times)


def test_they_come_back_as_they_were_written(tmp_path: Path) -> None:
    ta.save_dataset(tmp_path / "d", dropped())
    read = ta.load_dataset(tmp_path / "d")
    assert read.times is not None
    assert all(np.array_equal(getattr(read.times, name), getattr(TIMES, name)) for name in vars(TIMES))
    assert hash_dataset(read) == hash_dataset(dropped())


def test_they_go_where_their_shots_go() -> None:
    both = join_datasets(dropped().take([2, 0]), Dataset("more", TOWER, Shots(("x",), {}, {}), times=Times(
        np.array([0]), np.array([1.0]), np.array([15.1]), np.array([0.02]))))
    assert both.times.shot.tolist() == [0, 1, 1, 2] and both.times.t_s.tolist() == [2.03, 1.02, 1.45, 1.0]


@pytest.mark.parametrize(("row", "said"), [
    ("a,15.0,0.0,0.02", "t_s"), ("a,15.0,1.0,0.0", "sigma_s"), ("a,15.0,1.0,-1", "sigma_s"), ("q,15.0,1.0,0.02", "'q'"),
    ("a,high,1.0,0.02", "height_m"), ("a,15.0,,0.02", "t_s"), ("a,9.0,1.4,0.02\na,9.5,1.3,0.02", "does not follow")])
def test_a_bad_cell_is_named_by_file_and_line(tmp_path: Path, row: str, said: str) -> None:
    ta.save_dataset(tmp_path / "d", dropped())
    text = f"shot_id,height_m,t_s,sigma_s\nb,15.0,1.0,0.02\n{row}\n"
    (tmp_path / "d" / "times.csv").write_text(text, encoding="utf-8")
    with pytest.raises(ta.InputError, match=rf"times.csv:[34].*{said}"):
        ta.load_dataset(tmp_path / "d")


def test_other_units_are_read_by_their_names(tmp_path: Path) -> None:
    ta.save_dataset(tmp_path / "d", dropped())
    (tmp_path / "d" / "times.csv").write_text("shot_id,height_ft,t_ms,sigma_ms\na,49.2126,1020,20\n", encoding="utf-8")
    times = ta.load_dataset(tmp_path / "d").times
    assert [times.height_m[0], times.t_s[0], times.sigma_s[0]] == pytest.approx([15.0, 1.02, 0.02], rel=1e-6)


def test_tracks_and_times_are_not_taken_together(tmp_path: Path) -> None:
    ta.save_dataset(tmp_path / "d", dropped())
    (tmp_path / "d" / "tracks.csv").write_text("shot_id,t_s,x_m,y_m,z_m\na,0,0,0,20\n", encoding="utf-8")
    with pytest.raises(ta.InputError, match="there are tracks, too"):
        ta.load_dataset(tmp_path / "d")


def test_one_slip_of_many_is_named() -> None:
    t_s = TIMES.t_s.copy()
    t_s[3] = 20.3                     # a point in the wrong place
    with pytest.raises(ta.InputError, match=r"c falls with 0\.0099 of gravity"):
        check_plausible(dropped(Times(**(vars(TIMES) | {"t_s": t_s}))))


@pytest.mark.parametrize(("change", "said"), [
    ({"height_m": 20.0 - (20.0 - TIMES.height_m) * 3.28084}, "heights look like feet"),
    ({"t_s": TIMES.t_s * 1000.0}, "times look like milliseconds"),
    ({"height_m": TIMES.height_m + 20.0}, "state the height that they fell from")])
def test_a_fall_that_cannot_be_is_refused(change: dict[str, np.ndarray], said: str) -> None:
    check_plausible(dropped())
    with pytest.raises(ta.InputError, match=said):
        check_plausible(dropped(Times(**(vars(TIMES) | change))))
