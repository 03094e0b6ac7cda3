"""Every kind of bad row or file is named with its place."""

import string

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.sim.data.files import GOOD, HEADER, RIG, write
from truearc.errors import InputError
from truearc.sim.data.files import load_dataset

BAD_ROWS = {
    "b,nan,50,0.5,two,,,": "3: distance_m: 'nan' is not a finite number",
    "b,3,inf,0.5,two,,,": "3: hood_deg: 'inf' is not a finite number",
    "b,3,50,1e999,two,,,": "3: motor_ratio: '1e999' is not a finite number",
    "b,-1,50,0.5,two,,,": "3: distance_m: -1 is out of range",
    "b,3,120,0.5,two,,,": "3: hood_deg: 120 is out of range (0 to 90)",
    "b,3,50,1.5,two,,,": "3: motor_ratio: 1.5 is out of range (0 to 1)",
    "b,3,50,fast,two,,,": "3: motor_ratio: 'fast' is not a finite number",
    "b,3,50,1_0,two,,,": "3: motor_ratio: '1_0' is not a finite number",
    "b,3,50,0.5,four,,,": "3: outcome: 'four' is none of miss, two, three",
    "b,3,50,0.5,miss,up,,": "3: side: 'up' is none of low, high, left, right",
    "b,3,50,0.5,three,low,,": "3: side: outcome three cannot have the miss side 'low'",
    "b,3,50,0.5,two,,,warm": "3: temperature_c: 'warm' is not a finite number",
    "b,3,50,0.5,two,,,NaN": "3: temperature_c: 'NaN' is not a finite number",
    "a,3,50,0.5,two,,,": "3: shot_id: 'a' stands already in",
    ",3,50,0.5,two,,,": "3: shot_id: is missing",
    "b,3,50,0.5,two": "3: 5 cells where the header has 8",
    "b,3,50,0.5,two,,,,9": "3: 9 cells where the header has 8",
}
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
    with pytest.raises(InputError) as error:
        load_dataset(write(tmp_path, shots, **more))
    assert message in str(error.value) and len(str(error.value).splitlines()) == 1


def test_a_blank_line_and_a_cell_of_two_lines_do_not_shift_the_count(tmp_path):
    write(tmp_path, f'{HEADER}\n{GOOD}\n\nb,3,50,0.5,two,,"day\n2",20\nc,3,99,0.5,two,,,\n')
    with pytest.raises(InputError, match=r"shots\.csv:6: hood_deg"):
        load_dataset(tmp_path)


def test_all_problems_are_listed_up_to_twenty(tmp_path):
    rows = "\n".join(f"r{number},far" for number in range(23))
    write(tmp_path, f"{HEADER}\nr,3,50,0.5,two,,,\n{rows}\n", tracks="shot_id,t_s,x_m,y_m,z_m\nr,0,0,0,\n")
    with pytest.raises(InputError) as error:
        load_dataset(tmp_path)
    lines = str(error.value).splitlines()
    assert len(lines) == 21
    assert "shots.csv:22: 2 cells where the header has 8" in lines[19]
    assert lines[20] == "... and 4 more problems (24 in all)"


def test_the_same_fault_of_many_cells_is_said_once(tmp_path):
    rows = "\n".join(f"r{number},3.2m,50,0.5,two,,," for number in range(23))
    write(tmp_path, f"{HEADER}\n{rows}\n")
    with pytest.raises(InputError, match=r"shots\.csv:2: distance_m: '3.2m' is not a finite number; write digits "
                                         r"alone, and the unit in the column's name; .*; here and in 22 more rows$"):
        load_dataset(tmp_path)


def test_bytes_that_are_no_text_are_named(tmp_path):
    write(tmp_path, "")
    (tmp_path / "shots.csv").write_bytes(b"shot_id,session\na,x\nb,\xff\n")
    with pytest.raises(InputError, match=r"shots\.csv:3: not UTF-8"):
        load_dataset(tmp_path)


def test_missing_files_are_named(tmp_path):
    with pytest.raises(InputError, match="no such directory"):
        load_dataset(tmp_path / "nowhere")
    with pytest.raises(InputError, match=r"rig\.toml"):
        load_dataset(tmp_path)
    (tmp_path / "rig.toml").write_text(RIG, encoding="utf-8")
    with pytest.raises(InputError, match=r"neither shots\.csv nor shots\.parquet"):
        load_dataset(tmp_path)


@settings(max_examples=150, deadline=None)
@given(st.text(alphabet=string.printable + "é\x00\ufeff", max_size=200))
def test_any_text_is_read_or_refused(tmp_path_factory, text):
    home = tmp_path_factory.mktemp("any")
    write(home, "")
    (home / "shots.csv").write_bytes(text.encode())
    try:
        shots = load_dataset(home).shots
    except InputError as error:
        assert "shots.csv" in str(error)
    else:
        assert all(np.isfinite(column[~np.isnan(column)]).all() for column in shots.numbers.values())
        assert len(set(shots.shot_id)) == len(shots)
