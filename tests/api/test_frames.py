"""Datasets from tables in memory: pandas, polars, NumPy and plain columns give what the same CSV files give."""

from pathlib import Path

import numpy as np
import pytest

import truearc as ta
from tests.sim.discover.worlds import FACTS

SHOTS = {"shot_id": ["a", "b", "c"], "distance_m": [3.0, 4.5, None], "hood_deg": [45.0, 50.0, 55.0],
         "motor_ratio": [0.5, 0.6, 0.7], "outcome": ["three", "two", None], "side": ["", None, "low"]}
TRACKS = {"shot_id": ["a", "a", "c"], "t_s": [0.0, 0.1, 0.0], "x_m": [0.0, 0.5, 0.1], "y_m": [0.0, 0.0, 0.0],
          "z_m": [0.7, 1.0, 0.8]}
TRACES = {"shot_id": ["b", "b"], "t_s": [0.0, 0.1], "signal": ["battery_v", "battery_v"], "value": [12.0, 11.9]}


def plain(columns):
    return columns


def pandas(columns):
    return pytest.importorskip("pandas").DataFrame(columns)


def polars(columns):
    return pytest.importorskip("polars").DataFrame(columns)


def numpy(columns):
    """A structured array; a missing text is empty, a missing number NaN."""
    columns = {name: np.array([cell if cell is not None else (np.nan if isinstance(cells[0], float) else "")
                               for cell in cells]) for name, cells in columns.items()}
    array = np.empty(len(columns["shot_id"]), [(name, cells.dtype) for name, cells in columns.items()])
    for name, cells in columns.items():
        array[name] = cells
    return array


@pytest.fixture
def loaded(tmp_path: Path) -> ta.Dataset:
    made = ta.dataset(SHOTS, tracks=TRACKS, traces=TRACES, rig=FACTS)
    ta.save_dataset(tmp_path / "d", made)
    return ta.load_dataset(tmp_path / "d")


def test_every_result_with_a_table_gives_it_to_pandas() -> None:
    frames = pytest.importorskip("pandas")
    sight = ta.identifiability(FACTS, shots=20)
    for result in (sight, sight.table()):
        frame = result.to_pandas()
        assert isinstance(frame, frames.DataFrame) and frame["term"].tolist() == sight.table().column("term")
    assert "<table>" in sight._repr_html_() and "<pre>" in sight._repr_html_()
    named = [getattr(ta, name) for name in dir(ta) if isinstance(getattr(ta, name), type)]
    assert all(hasattr(one, "to_pandas") for one in named if callable(getattr(one, "table", None)))


@pytest.mark.parametrize("kind", [plain, pandas, lambda columns: pandas(columns).convert_dtypes(), polars, numpy])
def test_every_kind_of_table_gives_what_the_files_give(kind, loaded) -> None:
    made = ta.dataset(shots=kind(SHOTS), tracks=kind(TRACKS), traces=kind(TRACES), rig=FACTS, name="d")
    assert (made.name, made.rig, made.shots.shot_id) == (loaded.name, loaded.rig, loaded.shots.shot_id)
    assert made.shots.texts == loaded.shots.texts and set(made.shots.numbers) == set(loaded.shots.numbers)
    for name, column in loaded.shots.numbers.items():
        np.testing.assert_array_equal(made.shots.numbers[name], column)
    for one, other in ((made.tracks, loaded.tracks), (made.traces, loaded.traces)):
        assert one is not None and other is not None
        for name, column in vars(other).items():
            np.testing.assert_array_equal(getattr(one, name), column)


@pytest.mark.parametrize("kind", [plain, pandas, polars])
@pytest.mark.parametrize(("change", "message"), [
    ({"distance_m": [3.0, float("inf"), 4.0]}, "shots: row 2: distance_m: inf is not a finite number"),
    ({"distance_m": ["3", "far", "4"]}, "shots: row 2: distance_m: 'far' is not a finite number"),
    ({"outcome": ["three", "four", ""]}, "shots: row 2: outcome: 'four' is none of miss, two, three"),
    ({"shot_id": ["a", "b", "a"]}, "shots: row 3: shot_id: 'a' stands already in shots: row 1"),
    ({"shot_id": ["a", None, "c"]}, "shots: row 2: shot_id: is missing"),
    ({"outcome": ["three", "two", "three"]}, "shots: row 3: side: outcome three cannot have the miss side 'low'")])
def test_a_bad_cell_is_named_by_table_row_and_column(kind, change, message) -> None:
    with pytest.raises(ta.InputError) as raised:
        ta.dataset(kind(SHOTS | change), rig=FACTS)
    assert message in str(raised.value)


def test_every_bad_cell_of_every_table_is_named_at_once() -> None:
    with pytest.raises(ta.InputError) as raised:
        ta.dataset(SHOTS | {"hood_deg": [91.0, 45.0, 45.0]}, tracks=TRACKS | {"shot_id": ["a", "a", "x"]},
                   traces=TRACES | {"value": [None, 1.0]}, rig=FACTS)
    assert str(raised.value).splitlines() == [
        "shots: row 1: hood_deg: 91 is out of range (0 to 90)", "tracks: row 3: shot_id: 'x' is not among the shots",
        "traces: row 1: value: is missing"]


@pytest.mark.parametrize(("shots", "message"), [
    ({"distance_m": [1.0]}, "shots: column shot_id is missing"),
    ({"shot_id": ["a"], "distance_m": [1.0, 2.0]}, "shots: columns differ in length: shot_id 1, distance_m 2"),
    ({"shot_id": ["a"], " ": [1.0]}, "shots: column ' ': a name is needed"),
    (np.zeros((2, 3)), "shots: an array without named columns"), ([1, 2], "shots: is of type list; a DataFrame")])
def test_what_is_no_table_of_shots_is_refused(shots, message) -> None:
    with pytest.raises(ta.InputError, match=message.replace("(", r"\(")):
        ta.dataset(shots, rig=FACTS)


def test_a_pandas_column_that_stands_twice_is_refused() -> None:
    frame = pandas({"shot_id": ["a"], "x": [1.0]}).set_axis(["shot_id"] * 2, axis=1)
    with pytest.raises(ta.InputError, match="shots: column 'shot_id' stands twice"):
        ta.dataset(frame, rig=FACTS)


def test_a_rig_may_be_a_value_a_path_or_a_mapping(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text("[ball]\nmass_kg = 0.14\nradius_m = 0.09\n[target]\ncentre_height_m = 2.4\n")
    table = {"ball": {"mass_kg": 0.14, "radius_m": 0.09}, "target": {"centre_height_m": 2.4}}
    rigs = [ta.dataset(SHOTS, rig=rig).rig for rig in (ta.load_rig(path), path, str(path), table)]
    assert all(rig == rigs[0] for rig in rigs)


@pytest.mark.parametrize(("rig", "message"), [
    ({"ball": {"mass_kg": 0.0, "radius_m": 0.1}}, "rig: ball.mass_kg: 0.0 must be above 0"),
    ({"ball": {"mass_kg": 0.1}}, "rig: ball.radius_m: missing key"),
    ({"ball": {"mass_kg": 0.1, "radius_m": 0.1, "colour": "red"}}, "rig: key ball.colour is not known"),
    ("nowhere.toml", "nowhere.toml"), (None, "rig: is of type NoneType; a Rig, the path")])
def test_a_bad_rig_is_named_by_its_key(rig, message) -> None:
    with pytest.raises(ta.InputError, match=message):
        ta.dataset(SHOTS, rig=rig)
