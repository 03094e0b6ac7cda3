"""Datasets loaded from CSV and Parquet."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.sim.data.files import GOOD, HEADER, RIG, write
from truearc.errors import InputError
from truearc.sim.data.files import hash_dataset, load_dataset


def test_reads_what_formats_md_shows(tmp_path):
    data = load_dataset(write(
        tmp_path, f"{HEADER},grip\n{GOOD},new\nb,4,45,,miss,low,,,\n",
        tracks="shot_id,t_s,x_m,y_m,z_m\na,0,0.1,0,0.8\na,0.01,0.2,0,0.9\nb,0,0,0,1\n",
        traces="shot_id,t_s,signal,value\nb,0.5,battery_v,12.1\n"))
    assert data.shots.shot_id == ("a", "b")
    assert data.facts.ball.mass_kg == 0.14
    np.testing.assert_array_equal(data.shots.number("motor_ratio"), [0.5, np.nan])
    np.testing.assert_array_equal(data.shots.number("temperature_c"), [20.5, np.nan])
    np.testing.assert_array_equal(data.shots.number("battery_v"), [np.nan, np.nan])
    assert data.shots.text("outcome") == ("three", "miss")
    assert data.shots.text("side") == ("", "low")
    assert data.shots.text("grip") == ("new", "")
    assert data.shots.text("ball_id") == ("", "")
    np.testing.assert_array_equal(data.tracks.shot, [0, 0, 1])
    assert data.traces.signal == ("battery_v",)
    assert data.left_out == ()


def test_take_keeps_rows_together(tmp_path):
    rows = f"{HEADER}\n{GOOD}\nb,4,45,0.6,miss,low,day2,21\nc,5,40,0.7,two,,day2,22\n"
    shots = load_dataset(write(tmp_path, rows)).shots
    some = shots.take([2, 0])
    assert some.shot_id == ("c", "a")
    assert some.text("outcome") == ("two", "three")
    np.testing.assert_array_equal(some.number("distance_m"), [5.0, 3.0])
    assert shots.take(np.array([False, True, False])).shot_id == ("b",)
    assert len(shots.take(np.array([], dtype=int))) == 0


def test_a_spreadsheets_byte_order_mark_and_line_ends_are_taken(tmp_path):
    write(tmp_path, "")
    (tmp_path / "shots.csv").write_bytes(b"\xef\xbb\xbfshot_id,distance_m\r\na,3\r\n\r\nb,4\r\n")
    np.testing.assert_array_equal(load_dataset(tmp_path).shots.number("distance_m"), [3.0, 4.0])


def test_ids_that_look_like_numbers_stay_text(tmp_path):
    shots = load_dataset(write(tmp_path, "shot_id,session,ball_id,lot\n007,1,2,3\n8,1,2,4\n")).shots
    assert shots.shot_id == ("007", "8")
    assert shots.text("session") == ("1", "1")
    assert shots.text("ball_id") == ("2", "2")
    np.testing.assert_array_equal(shots.number("lot"), [3.0, 4.0])


def parquet_of(home: Path, **columns: list) -> Path:
    home.mkdir()
    (home / "rig.toml").write_text(RIG, encoding="utf-8")
    pq.write_table(pa.table(columns), home / "shots.parquet")
    return home


def test_parquet_says_the_same_as_csv(tmp_path):
    columns = {"distance_m": [3.0, None], "session": ["x", None], "shot_id": ["a", "b"], "hood_deg": [50, 51]}
    parquet = parquet_of(tmp_path / "p", **columns)
    (tmp_path / "c").mkdir()
    csv = write(tmp_path / "c", "shot_id,hood_deg,distance_m,session\na,50,3.0,x\nb,51.0,,\n")
    assert load_dataset(parquet).shots.text("session") == ("x", "")
    np.testing.assert_array_equal(load_dataset(parquet).shots.number("distance_m"), [3.0, np.nan])
    assert hash_dataset(load_dataset(parquet)) == hash_dataset(load_dataset(csv))
    (csv / "shots.csv").write_text("shot_id,hood_deg,distance_m,session\na,50,3.0000000000000004,x\nb,51.0,,\n")
    assert hash_dataset(load_dataset(parquet)) != hash_dataset(load_dataset(csv))


def test_a_bad_parquet_row_is_named(tmp_path):
    home = parquet_of(tmp_path / "p", shot_id=["a", "b"], distance_m=[3.0, float("nan")], outcome=["two", "four"])
    with pytest.raises(InputError) as error:
        load_dataset(home)
    assert "shots.parquet: row 2: distance_m: nan is not a finite number" in str(error.value)
    assert "shots.parquet: row 2: outcome: 'four'" in str(error.value)


def test_a_torn_parquet_file_is_named(tmp_path):
    home = parquet_of(tmp_path / "p", shot_id=["a"])
    (home / "shots.parquet").write_bytes((home / "shots.parquet").read_bytes()[:20])
    with pytest.raises(InputError, match=r"shots\.parquet"):
        load_dataset(home)


def test_two_files_of_one_table_are_refused(tmp_path):
    home = parquet_of(tmp_path / "p", shot_id=["a"])
    (home / "shots.csv").write_text("shot_id\na\n")
    with pytest.raises(InputError, match=r"both shots\.csv and shots\.parquet"):
        load_dataset(home)
