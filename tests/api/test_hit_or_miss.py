"""A game in which every hit counts alike: from a spreadsheet of hits and misses to the robot's gate."""

import csv
import re
from pathlib import Path

import numpy as np
import pytest

import truearc as ta
from truearc.cli.common import load_any_rig

SPREADSHEET = Path(__file__).parents[2] / "examples/spreadsheet"


def write(folder: Path, drop_three: bool = True, words: dict[str, str] | None = None) -> Path:
    """The example with hits for twos and threes, and without a three in rig.toml."""
    folder.mkdir()
    rig = (SPREADSHEET / "rig.toml").read_text(encoding="utf-8").splitlines(keepends=True)
    kept = [line for line in rig if not (drop_three and line.startswith("three_half_height_m"))]
    (folder / "rig.toml").write_text("".join(kept), encoding="utf-8")
    with open(SPREADSHEET / "shots.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    words = words or {"two": "hit", "three": "Hit"}
    with open(folder / "shots.csv", "w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(row | {"outcome": words.get(row["outcome"], row["outcome"])} for row in rows)
    return folder


def test_a_hit_is_a_two_of_a_target_without_a_three(tmp_path: Path) -> None:
    week = ta.load_dataset(write(tmp_path / "week"))
    assert week.rig.target is not None and week.rig.target.hit_or_miss
    assert set(week.shots.text("outcome")) == {"miss", "two"}
    ta.save_dataset(tmp_path / "again", week)
    again = ta.load_dataset(tmp_path / "again")
    assert again.rig == week.rig and again.shots.text("outcome") == week.shots.text("outcome")
    rig = {"ball": {"mass_kg": 0.14, "radius_m": 0.09}, "target": {"centre_height_m": 2.0}}
    shots = {"shot_id": ["a", "b"], "outcome": ["hit", "miss"]}
    in_memory = ta.dataset(shots, rig=rig)
    assert in_memory.shots.text("outcome") == ("two", "miss") and in_memory.rig.target is not None
    assert in_memory.rig.target.hit_or_miss


@pytest.mark.parametrize("drop_three,words", [(False, {"two": "hit", "three": "hit"}), (True, {"two": "hit"})])
def test_a_hit_that_may_be_a_three_is_an_error(tmp_path: Path, drop_three: bool, words: dict[str, str]) -> None:
    with pytest.raises(ta.InputError, match=r"\A\S+shots\.csv:\d+: outcome: 'hit' may be a two or a three: "
                       r"write which, here and in \d+ more rows; .*\Z"):
        ta.load_dataset(write(tmp_path / "week", drop_three, words))


def test_a_three_where_every_hit_counts_alike_is_an_error(tmp_path: Path) -> None:
    folder = write(tmp_path / "week", words={"two": "hit", "three": "3"})
    (folder / "rig.toml").write_text((folder / "rig.toml").read_text().replace(
        "[target]\n", "[target]\nthree_half_height_m = 0\n"))
    with pytest.raises(ta.InputError, match=r"shots\.csv:\d+: outcome: is three in \d+ rows, but "
                       r"target\.three_half_height_m = 0 of rig\.toml says that every hit counts alike: write hit"):
        ta.load_dataset(folder)


def test_who_aims_without_a_three_is_told_what_is_taken(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    load_any_rig(str(SPREADSHEET / "rig.toml"))
    assert capsys.readouterr().err == ""
    load_any_rig(str(write(tmp_path / "week") / "rig.toml"))
    assert "target.three_half_height_m is not stated: 0.07 is taken; write 0 where" in capsys.readouterr().err


@pytest.fixture(scope="module")
def week(tmp_path_factory: pytest.TempPathFactory) -> ta.Dataset:
    return ta.load_dataset(write(tmp_path_factory.mktemp("hits") / "week"))


@pytest.fixture(scope="module")
def belief(week: ta.Dataset) -> ta.Belief:
    return ta.fit(week).belief


def test_from_fit_to_gate(week: ta.Dataset, belief: ta.Belief, tmp_path: Path) -> None:
    hit = np.array([one != "miss" for one in week.shots.text("outcome")])
    forecast = np.array(ta.predict(week, belief).column("outcome"))
    assert set(forecast) <= {"miss", "two"} and ((forecast == "two") == hit).mean() > 0.7
    assert re.search(r"48 shots \(\d+ miss, \d+ hit\)", str(week)) and "two" not in str(week)
    trained = ta.train_gate(week, belief, seed=0)
    assert "always naming the commonest, hit: outcome right" in str(trained)
    assert trained.holdout is not None and trained.holdout.brier < 0.2
    trained.export(tmp_path / "gate.onnx")
    rated = ta.predict(week, gate=tmp_path / "gate.onnx")
    p = np.array([rated.column("p_two"), rated.column("p_three")], float).T
    assert np.abs(p[:, 0] - p[:, 1]).max() < 0.02                  # a hit, apart from marks that are slips
    assert p[hit, 1].mean() > p[~hit, 1].mean() + 0.3 and abs(p[:, 1].mean() - hit.mean()) < 0.1


def test_aim_is_told_in_hits(week: ta.Dataset, belief: ta.Belief) -> None:
    table = ta.aim(belief, week.rig, distances_m=[3.0])
    head, row = table.lines()[0], table.lines()[-1]
    assert "P(hit)" in head and "P(three)" not in head and "points" not in head
    (one,) = table.rows
    assert table.lines("ft")[0].split()[0] == "ft" and table.lines("ft")[-1].split()[0] == "9.84"
    assert f"{one.p_two:.0%}" in row and (one.lost_1deg < 0.01 or f"{-one.lost_1deg / 2.0:+.0%}" in row)
    labels = [text.get_text() for text in table.plot().axes[2].get_legend().get_texts()]
    assert labels == ["hit"]
    threes = ta.load_dataset(SPREADSHEET)
    assert "P(three)" in ta.aim(belief, threes.rig, distances_m=[3.0]).lines()[0]
