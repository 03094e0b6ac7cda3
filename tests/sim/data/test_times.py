"""times.csv: read strictly, written back exactly, and refused beside tracks or where a ball cannot have been."""

from pathlib import Path

import numpy as np
import pytest

import truearc as ta
from truearc.robot.config.rig_spec import Air, Ball, LauncherFacts, Rig
from truearc.sim.check.check import check_plausible
from truearc.sim.data.dataset import Dataset, Shots, Times, join_datasets
from truearc.sim.data.files import hash_dataset

RIG = Rig(Ball(0.14, 0.0889), LauncherFacts(release_height_m=20.0), air=Air(1.2))
IDS = ("a", "b", "c")
TIMES = Times(np.array([0, 0, 1, 2]), np.array([1.02, 1.45, 1.01, 2.03]), np.array([15.0, 10.0, 15.0, 0.0]),
              np.array([0.02, 0.02, 0.01, 0.02]))


def dropped(times: Times = TIMES) -> Dataset:
    return Dataset("drops", RIG, Shots(IDS, {}, {}), times=times)


def test_they_come_back_as_they_were_written(tmp_path: Path) -> None:
    ta.save_dataset(tmp_path / "d", dropped())
    read = ta.load_dataset(tmp_path / "d")
    assert read.times is not None
    assert all(np.array_equal(getattr(read.times, name), getattr(TIMES, name)) for name in vars(TIMES))
    assert hash_dataset(read) == hash_dataset(dropped())


def test_they_go_where_their_shots_go() -> None:
    both = join_datasets(dropped().take([2, 0]), Dataset("more", RIG, Shots(("x",), {}, {}), times=Times(
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
