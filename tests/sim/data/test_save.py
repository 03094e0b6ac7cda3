"""A saved dataset reads back exactly, and no file is overwritten."""

import string

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.sim.data.files import FACTS
from truearc.errors import InputError
from truearc.robot.config.rig_spec import Ball, LauncherFacts, Rig, Wheel
from truearc.sim.data.dataset import Dataset, Shots, Traces, Tracks
from truearc.sim.data.files import load_dataset, save_dataset

WORDS = st.text(alphabet=st.characters(codec="utf-8", exclude_characters="\x00"), max_size=8)
NUMBERS = st.one_of(st.floats(allow_nan=False, allow_infinity=False), st.just(float("nan")))


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
