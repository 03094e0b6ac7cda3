"""Datasets: they read back exactly, and every kind of bad row is named with its place."""

import string
from pathlib import Path

import msgspec
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robot.config import BadInput
from robot.facts import Ball, Facts, LauncherFacts, Target, Wheel
from sim.shots import Dataset, Shots, Traces, Tracks, dataset_hash, load_dataset, load_rig, save_dataset, save_rig

RIG = """
[ball]
mass_kg = 0.14
radius_m = 0.0889
[target]
centre_height_m = 2.44
"""
HEADER = "shot_id,distance_m,hood_deg,motor_ratio,outcome,side,session,temperature_c"
GOOD = "a,3.0,50.0,0.5,three,,day1,20.5"
FACTS = Facts(ball=Ball(0.14, 0.0889), launcher=LauncherFacts(0.75, 594.0, (Wheel("lower", 0.05, 1.0, 180.0),)),
              target=Target(2.44))


def _write(home: Path, shots: str, rig: str = RIG, **others: str) -> Path:
    (home / "rig.toml").write_text(rig, encoding="utf-8")
    for name, text in {"shots": shots, **others}.items():
        (home / f"{name}.csv").write_text(text, encoding="utf-8")
    return home


# -- reading ----------------------------------------------------------------------------------------------------------

def test_reads_what_formats_md_shows(tmp_path):
    data = load_dataset(_write(
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
    shots = load_dataset(_write(tmp_path, rows)).shots
    some = shots.take([2, 0])
    assert some.shot_id == ("c", "a")
    assert some.text("outcome") == ("two", "three")
    np.testing.assert_array_equal(some.number("distance_m"), [5.0, 3.0])
    assert shots.take(np.array([False, True, False])).shot_id == ("b",)
    assert len(shots.take(np.array([], dtype=int))) == 0


def test_a_spreadsheets_byte_order_mark_and_line_ends_are_taken(tmp_path):
    _write(tmp_path, "")
    (tmp_path / "shots.csv").write_bytes(b"\xef\xbb\xbfshot_id,distance_m\r\na,3\r\n\r\nb,4\r\n")
    np.testing.assert_array_equal(load_dataset(tmp_path).shots.number("distance_m"), [3.0, 4.0])


def test_ids_that_look_like_numbers_stay_text(tmp_path):
    shots = load_dataset(_write(tmp_path, "shot_id,session,ball_id,lot\n007,1,2,3\n8,1,2,4\n")).shots
    assert shots.shot_id == ("007", "8")
    assert shots.text("session") == ("1", "1")
    assert shots.text("ball_id") == ("2", "2")
    np.testing.assert_array_equal(shots.number("lot"), [3.0, 4.0])


# -- bad rows ---------------------------------------------------------------------------------------------------------

BAD_ROWS = {
    "b,nan,50,0.5,two,,,": "shots.csv:3: distance_m: nan is not finite",
    "b,3,inf,0.5,two,,,": "shots.csv:3: hood_deg: inf is not finite",
    "b,3,50,1e999,two,,,": "shots.csv:3: motor_ratio: 1e999 is not finite",
    "b,-1,50,0.5,two,,,": "shots.csv:3: distance_m: -1 is out of range",
    "b,3,120,0.5,two,,,": "shots.csv:3: hood_deg: 120 is out of range (0 to 90)",
    "b,3,50,1.5,two,,,": "shots.csv:3: motor_ratio: 1.5 is out of range (0 to 1)",
    "b,3,50,fast,two,,,": "shots.csv:3: motor_ratio: 'fast' is not a number",
    "b,3,50,1_0,two,,,": "shots.csv:3: motor_ratio: '1_0' is not a number",
    "b,3,50,0.5,four,,,": "shots.csv:3: outcome: 'four' is none of miss, two, three",
    "b,3,50,0.5,miss,up,,": "shots.csv:3: side: 'up' is none of low, high, left, right",
    "b,3,50,0.5,three,low,,": "shots.csv:3: side: outcome three cannot have the miss side 'low'",
    "b,3,50,0.5,two,,,warm": "shots.csv:3: temperature_c: 'warm' is not a number",
    "b,3,50,0.5,two,,,NaN": "shots.csv:3: temperature_c: NaN is not finite",
    "a,3,50,0.5,two,,,": "shots.csv:3: shot_id: 'a' stands already in",
    ",3,50,0.5,two,,,": "shots.csv:3: shot_id: is missing",
    "b,3,50,0.5,two": "shots.csv:3: 5 cells where the header has 8",
    "b,3,50,0.5,two,,,,9": "shots.csv:3: 9 cells where the header has 8",
}


@pytest.mark.parametrize(("row", "message"), BAD_ROWS.items())
def test_a_bad_row_is_named(tmp_path, row, message):
    _write(tmp_path, f"{HEADER}\n{GOOD}\n{row}\n")
    with pytest.raises(BadInput) as error:
        load_dataset(tmp_path)
    assert message in str(error.value)
    assert len(str(error.value).splitlines()) == 1


def test_a_blank_line_and_a_cell_of_two_lines_do_not_shift_the_count(tmp_path):
    _write(tmp_path, f'{HEADER}\n{GOOD}\n\nb,3,50,0.5,two,,"day\n2",20\nc,3,99,0.5,two,,,\n')
    with pytest.raises(BadInput, match=r"shots\.csv:6: hood_deg"):
        load_dataset(tmp_path)


def test_all_problems_are_listed_up_to_twenty(tmp_path):
    rows = "\n".join(f"r{number},-1,50,0.5,two,,," for number in range(23))
    _write(tmp_path, f"{HEADER}\n{rows}\n", tracks="shot_id,t_s,x_m,y_m,z_m\nr0,0,0,0,\n")
    with pytest.raises(BadInput) as error:
        load_dataset(tmp_path)
    lines = str(error.value).splitlines()
    assert len(lines) == 21
    assert "shots.csv:21: distance_m" in lines[19]
    assert lines[20] == "... and 4 more problems (24 in all)"


@pytest.mark.parametrize(("tracks", "message"), [
    ("z,0,0,0,0", "tracks.csv:3: shot_id: 'z' is not among the shots"),
    ("a,0,0,0,0", "tracks.csv:3: t_s: 0 does not follow 0 of the same shot"),
    ("a,1,,0,0", "tracks.csv:3: x_m: is missing"),
    ("a,1,0,0,inf", "tracks.csv:3: z_m: inf is not finite"),
])
def test_a_bad_track_sample_is_named(tmp_path, tracks, message):
    _write(tmp_path, f"{HEADER}\n{GOOD}\n", tracks=f"shot_id,t_s,x_m,y_m,z_m\na,0,0,0,1\n{tracks}\n")
    with pytest.raises(BadInput) as error:
        load_dataset(tmp_path)
    assert message in str(error.value)


def test_a_bad_trace_sample_is_named(tmp_path):
    _write(tmp_path, f"{HEADER}\n{GOOD}\n", traces="shot_id,t_s,signal,value\na,0,,1\na,0,battery_v,full\n")
    with pytest.raises(BadInput) as error:
        load_dataset(tmp_path)
    assert "traces.csv:2: signal: is missing" in str(error.value)
    assert "traces.csv:3: value: 'full' is not a number" in str(error.value)


@pytest.mark.parametrize(("shots", "message"), [
    ("", "shots.csv:1: the header is missing"),
    ("distance_m\n3\n", "shots.csv:1: column shot_id is missing"),
    ("shot_id,a,a\nx,1,2\n", "shots.csv:1: column 'a' stands twice"),
    ("shot_id,\nx,1\n", "shots.csv:1: column '' has no name"),
    ('shot_id,a\nx,"1\n', "shots.csv:2: unexpected end of data"),
])
def test_a_broken_file_is_named(tmp_path, shots, message):
    with pytest.raises(BadInput) as error:
        load_dataset(_write(tmp_path, shots))
    assert message in str(error.value)


def test_bytes_that_are_no_text_are_named(tmp_path):
    _write(tmp_path, "")
    (tmp_path / "shots.csv").write_bytes(b"shot_id,session\na,x\nb,\xff\n")
    with pytest.raises(BadInput, match=r"shots\.csv:3: not UTF-8"):
        load_dataset(tmp_path)


def test_missing_files_are_named(tmp_path):
    with pytest.raises(BadInput, match="no such directory"):
        load_dataset(tmp_path / "nowhere")
    with pytest.raises(BadInput, match=r"rig\.toml"):
        load_dataset(tmp_path)
    (tmp_path / "rig.toml").write_text(RIG, encoding="utf-8")
    with pytest.raises(BadInput, match=r"neither shots\.csv nor shots\.parquet"):
        load_dataset(tmp_path)


@settings(max_examples=150, deadline=None)
@given(st.text(alphabet=string.printable + "é\x00\ufeff", max_size=200))
def test_any_text_is_read_or_refused(tmp_path_factory, text):
    home = tmp_path_factory.mktemp("any")
    _write(home, "")
    (home / "shots.csv").write_bytes(text.encode())
    try:
        shots = load_dataset(home).shots
    except BadInput as error:
        assert "shots.csv" in str(error)
    else:
        assert all(np.isfinite(column[~np.isnan(column)]).all() for column in shots.numbers.values())
        assert len(set(shots.shot_id)) == len(shots)


# -- rig.toml ---------------------------------------------------------------------------------------------------------

def test_unknown_rig_keys_are_warned_of(tmp_path, capsys):
    load_dataset(_write(tmp_path, f"{HEADER}\n{GOOD}\n", rig=RIG + "[believ]\nterms = []\n[air]\ndensty = 1.2\n"))
    warnings = capsys.readouterr().err
    assert "rig.toml: key believ is not known" in warnings
    assert "rig.toml: key air.densty is not known" in warnings


@pytest.mark.parametrize(("old", "new", "message"), [
    ("mass_kg = 0.14", "mass_kg = 0.0", "ball.mass_kg: 0.0 must be above 0"),
    ("mass_kg = 0.14", "mass_kg = nan", "ball.mass_kg: nan is not finite"),
    ("mass_kg = 0.14", "mass_kg = 'light'", "mass_kg"),
    ("mass_kg = 0.14", "", "mass_kg"),
    ("centre_height_m = 2.44", "centre_height_m = 2.44\nthree_half_height_m = 0.5", "target.three_half_height_m"),
    ("[target]", "[air]\ndensity_kg_m3 = -1.0\n[target]", "air.density_kg_m3: -1.0 must not be below 0"),
])
def test_a_bad_rig_is_named(tmp_path, old, new, message):
    with pytest.raises(BadInput) as error:
        load_dataset(_write(tmp_path, f"{HEADER}\n{GOOD}\n", rig=RIG.replace(old, new)))
    assert "rig.toml" in str(error.value)
    assert message in str(error.value)


# -- writing ----------------------------------------------------------------------------------------------------------

WORDS = st.text(alphabet=st.characters(codec="utf-8", exclude_characters="\x00"), max_size=8)
NUMBERS = st.one_of(st.floats(allow_nan=False, allow_infinity=False), st.just(float("nan")))


def _range(low: float, high: float) -> st.SearchStrategy[float]:
    return st.one_of(st.floats(low, high), st.just(float("nan")))


@st.composite
def datasets(draw: st.DrawFn) -> Dataset:
    ids = tuple(draw(st.lists(WORDS.filter(bool), min_size=1, max_size=6, unique=True)))
    columns = {"distance_m": _range(0, 100), "hood_deg": _range(0, 90), "motor_ratio": _range(0, 1),
               "battery_v": NUMBERS, "exit_spin_rev_s": _range(-1000, 1000)}
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
    facts = msgspec.structs.replace(FACTS, ball=Ball(draw(st.floats(1e-6, 1e6)), draw(st.floats(1e-6, 1e6))),
                                    launcher=LauncherFacts(draw(st.floats(0, 3)), None, (
                                        Wheel(draw(WORDS), 0.05, draw(st.floats(-2, 2)), draw(st.floats(0, 360))),)))
    left_out = tuple(draw(st.lists(st.text(string.ascii_letters + " :", min_size=1, max_size=20), max_size=3)))
    return Dataset("d", facts, Shots(ids, numbers, texts), Tracks(shot, times, *spot), traces, left_out)


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
    dataset = Dataset("d", Facts(Ball(0.14, 0.0889)), Shots(("a",), {}, {}))
    save_dataset(tmp_path / "new" / "d", dataset)
    before = {path.name: path.read_bytes() for path in (tmp_path / "new" / "d").iterdir()}
    with pytest.raises(BadInput, match="not an empty directory"):
        save_dataset(tmp_path / "new" / "d", dataset)
    assert {path.name: path.read_bytes() for path in (tmp_path / "new" / "d").iterdir()} == before
    (tmp_path / "file").touch()
    with pytest.raises(BadInput, match="file"):
        save_dataset(tmp_path / "file", dataset)


def test_an_infinite_number_is_not_written(tmp_path):
    with pytest.raises(ValueError, match="distance_m"):
        save_dataset(tmp_path, Dataset("d", FACTS, Shots(("a",), {"distance_m": np.array([np.inf])}, {})))


def test_a_rig_reads_back(tmp_path):
    save_rig(tmp_path / "rig.toml", FACTS)
    assert load_rig(tmp_path / "rig.toml") == FACTS


# -- Parquet and the hash ---------------------------------------------------------------------------------------------

def _parquet(home: Path, **columns: list) -> Path:
    home.mkdir()
    (home / "rig.toml").write_text(RIG, encoding="utf-8")
    pq.write_table(pa.table(columns), home / "shots.parquet")
    return home


def test_parquet_says_the_same_as_csv(tmp_path):
    columns = {"distance_m": [3.0, None], "session": ["x", None], "shot_id": ["a", "b"], "hood_deg": [50, 51]}
    parquet = _parquet(tmp_path / "p", **columns)
    (tmp_path / "c").mkdir()
    csv = _write(tmp_path / "c", "shot_id,hood_deg,distance_m,session\na,50,3.0,x\nb,51.0,,\n")
    assert load_dataset(parquet).shots.text("session") == ("x", "")
    np.testing.assert_array_equal(load_dataset(parquet).shots.number("distance_m"), [3.0, np.nan])
    assert dataset_hash(parquet) == dataset_hash(csv)
    (csv / "shots.csv").write_text("shot_id,hood_deg,distance_m,session\na,50,3.0000000000000004,x\nb,51.0,,\n")
    assert dataset_hash(parquet) != dataset_hash(csv)


def test_a_bad_parquet_row_is_named(tmp_path):
    home = _parquet(tmp_path / "p", shot_id=["a", "b"], distance_m=[3.0, float("nan")], outcome=["two", "four"])
    with pytest.raises(BadInput) as error:
        load_dataset(home)
    assert "shots.parquet: row 2: distance_m: nan is not finite" in str(error.value)
    assert "shots.parquet: row 2: outcome: 'four'" in str(error.value)


def test_a_torn_parquet_file_is_named(tmp_path):
    home = _parquet(tmp_path / "p", shot_id=["a"])
    (home / "shots.parquet").write_bytes((home / "shots.parquet").read_bytes()[:20])
    with pytest.raises(BadInput, match=r"shots\.parquet"):
        load_dataset(home)


def test_two_files_of_one_table_are_refused(tmp_path):
    home = _parquet(tmp_path / "p", shot_id=["a"])
    (home / "shots.csv").write_text("shot_id\na\n")
    with pytest.raises(BadInput, match=r"both shots\.csv and shots\.parquet"):
        load_dataset(home)
