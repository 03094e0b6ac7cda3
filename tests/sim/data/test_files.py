"""Datasets and rigs loaded from files, and saved so that they read back exactly."""

import string
from pathlib import Path

import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.sim.data.files import FACTS, GOOD, HEADER, RIG, write
from truearc.errors import InputError
from truearc.robot.config.rig_spec import Ball, LauncherFacts, Rig, Wheel
from truearc.sim.data.dataset import Dataset, Shots, Traces, Tracks
from truearc.sim.data.files import hash_dataset, load_dataset, load_rig, save_dataset

WORDS = st.text(alphabet=st.characters(codec="utf-8", exclude_characters="\x00"), max_size=8)


def test_reads_what_formats_md_shows(tmp_path):
    data = load_dataset(write(tmp_path, f"{HEADER},grip\n{GOOD},new\nb,4,45,,miss,low,,,\n",
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


def test_two_files_of_one_table_are_refused(tmp_path):
    home = parquet_of(tmp_path / "p", shot_id=["a"])
    (home / "shots.csv").write_text("shot_id\na\n")
    with pytest.raises(InputError, match=r"both shots\.csv and shots\.parquet"):
        load_dataset(home)


def in_range(low: float, high: float) -> st.SearchStrategy[float]:
    return st.one_of(st.floats(low, high), st.just(float("nan")))


@st.composite
def datasets(draw: st.DrawFn) -> Dataset:
    ids = tuple(draw(st.lists(WORDS.filter(bool), min_size=1, max_size=6, unique=True)))
    columns = {"distance_m": in_range(0, 100), "hood_deg": in_range(0, 90), "motor_ratio": in_range(0, 1),
               "battery_v": in_range(0, 1000), "exit_spin_rev_s": in_range(-1000, 1000)}
    count = len(ids)
    numbers = {name: np.array(draw(st.lists(values, min_size=count, max_size=count)))
               for name, values in columns.items()}
    texts = {"outcome": tuple(draw(st.lists(st.sampled_from(["", "miss", "two"]), min_size=count, max_size=count))),
             "side": tuple(draw(st.lists(st.sampled_from(["", "low", "right"]), min_size=count, max_size=count))),
             "session": tuple(draw(st.lists(WORDS, min_size=count, max_size=count)))}
    times = np.array(sorted(draw(st.sets(st.floats(0, 10), min_size=1, max_size=5))))
    spot = [np.array(draw(st.lists(st.floats(-50, 50), min_size=times.size, max_size=times.size))) for _ in range(3)]
    shot = np.full(times.size, draw(st.integers(0, count - 1)))
    traces = Traces(shot, times, ("battery_v",) * times.size, spot[0])
    rig = msgspec.structs.replace(FACTS, ball=Ball(draw(st.floats(1e-4, 1e3)), draw(st.floats(1e-3, 1e6))),
                                    launcher=LauncherFacts(draw(st.floats(0, 3)), None, (
                                        Wheel(draw(WORDS), 0.05, draw(st.floats(1e-3, 2)), draw(st.floats(0, 360))),)))
    left_out = tuple(draw(st.lists(st.text(string.ascii_letters + " :", min_size=1, max_size=20), max_size=3)))
    return Dataset("d", rig, Shots(ids, numbers, texts), Tracks(shot, times, *spot), traces, left_out)


@settings(max_examples=100, deadline=None)
@given(datasets())
def test_what_is_saved_reads_back_exactly(tmp_path_factory, data):
    home = tmp_path_factory.mktemp("round") / "d"
    save_dataset(home, data)
    back = load_dataset(home)
    assert (back.name, back.facts, back.left_out) == ("d", data.facts, data.left_out)
    assert back.shots.shot_id == data.shots.shot_id
    assert back.shots.texts == data.shots.texts
    assert back.shots.numbers.keys() == data.shots.numbers.keys()
    for name, column in data.shots.numbers.items():
        np.testing.assert_array_equal(back.shots.numbers[name], column)
    for mine, theirs in ((data.tracks, back.tracks), (data.traces, back.traces)):
        for name, column in vars(mine).items():
            np.testing.assert_array_equal(getattr(theirs, name), column)


def test_saving_never_touches_what_lies_there(tmp_path):
    dataset = Dataset("d", Rig(Ball(0.14, 0.0889)), Shots(("a",), {}, {}))
    save_dataset(tmp_path / "new" / "d", dataset)
    before = {path.name: path.read_bytes() for path in (tmp_path / "new" / "d").iterdir()}
    with pytest.raises(InputError, match="not an empty directory"):
        save_dataset(tmp_path / "new" / "d", dataset)
    assert {path.name: path.read_bytes() for path in (tmp_path / "new" / "d").iterdir()} == before
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="file"):
        save_dataset(tmp_path / "file", dataset)


def test_an_infinite_number_is_not_written(tmp_path):
    with pytest.raises(ValueError, match="distance_m"):
        save_dataset(tmp_path, Dataset("d", FACTS, Shots(("a",), {"distance_m": np.array([np.inf])}, {})))


@pytest.mark.parametrize(("old", "new", "message"), [
    ("mass_kg = 0.14", "mass_kg = 0.0", "ball.mass_kg: 0.0 must be above 0"),
    ("mass_kg = 0.14", "mass_kg = 'light'", "mass_kg"),
    ("mass_kg = 0.14", "", "mass_kg"),
    ("centre_height_m = 2.44", "centre_height_m = 2.44\nthree_half_height_m = 0.5", "target.three_half_height_m"),
    ("[target]", "[world]\ngravity_m_s2 = -9.81\n[target]",
     "world.gravity_m_s2: -9.81 must be above 0; it is a size and points down: write 9.81"),
    ("[target]", '[believe]\nterms = ["drag", "drag"]\n[target]', "believe.terms: 'drag' stands there more than once"),
    ("[target]", "[air]\ndensity_kg_m3 = -1.0\n[target]", "air.density_kg_m3: -1.0 must not be below 0")])
def test_a_bad_rig_is_named(tmp_path, old, new, message):
    with pytest.raises(InputError) as error:
        load_dataset(write(tmp_path, f"{HEADER}\n{GOOD}\n", rig=RIG.replace(old, new)))
    assert "rig.toml" in str(error.value)
    assert message in str(error.value)


def test_a_key_that_is_not_known_is_named_beside_the_one_that_is_missing(tmp_path, capsys):
    path = tmp_path / "rig.toml"
    path.write_text("[ball]\nmass_g = 140\nradius_m = 0.09\n")
    with pytest.raises(InputError, match=r"ball\.mass_kg: missing key"):
        load_rig(path)
    assert "key ball.mass_g is not known" in capsys.readouterr().err
