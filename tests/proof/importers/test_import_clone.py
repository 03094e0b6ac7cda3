"""Importing a team's history out of a git clone: the same as from the table of it, and what is no history refused."""

import csv
import json
import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest

import truearc.cli.main as truearc
from tests.proof.importers.test_import_set_points import HISTORY, config, write
from truearc.errors import InputError
from truearc.sim.data.dataset import Dataset
from truearc_proof.importers.frc_3476 import FILE
from truearc_proof.importers.set_points import import_3476

pytestmark = pytest.mark.skipif(shutil.which("git") is None, reason="needs git")

Point = tuple[float, float, float]    # elevation, wheel in rpm, distance in inches
FIRST: list[Point] = [(30.0, 4500.0, 80.0), (25.0, 4500.0, 120.0)]
LATER: list[Point] = [(30.0, 4400.0, 80.0), (25.0, 4500.0, 120.0)]


def git(clone: Path, *words: str, when: str = "2021-11-01T00:00:00+00:00") -> str:
    somebody = {"GIT_AUTHOR_NAME": "a", "GIT_AUTHOR_EMAIL": "a@b.c", "GIT_COMMITTER_NAME": "a", "GIT_COMMITTER_EMAIL":
                "a@b.c", "GIT_COMMITTER_DATE": when, "GIT_AUTHOR_DATE": when, "GIT_CONFIG_GLOBAL": os.devnull}
    return subprocess.run(("git", "-C", str(clone), *words), env=os.environ | somebody, check=True, capture_output=True,
                          text=True).stdout


def commit(clone: Path, text: str | None, when: str) -> None:
    path = clone / FILE
    path.parent.mkdir(parents=True, exist_ok=True)
    if text is None:
        path.unlink()
    else:
        path.write_text(text)
    git(clone, "add", "--all")
    git(clone, "commit", "--quiet", "-m", "tuned", when=when)


def clone_of(folder: Path, versions: Sequence[tuple[str, list[Point]]]) -> Path:
    """A repository with those versions, oldest first."""
    folder.mkdir()
    git(folder, "init", "--quiet")
    for k, (when, points) in enumerate(versions):
        # every other one is also formatted anew, as the real last one is, or git would see no change in it
        text = json.dumps({"shooterConfigs": [config(*point) for point in points]}, indent=1 + k % 2)
        commit(folder, text, when)
    return folder


def without_names(dataset: Dataset) -> list[tuple[float, ...]]:
    """Each shot's numbers; a clone's commits have names of their own."""
    numbers = dataset.shots.numbers
    return [tuple(row) for row in zip(*(numbers[name].tolist() for name in sorted(numbers)), strict=True)]


def test_a_clones_history_says_the_same_as_the_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    days = ("2021-11-01T09:00:00+01:00", "2021-11-02T08:00:00+00:00")
    clone = clone_of(tmp_path / "FRC-2020", list(zip(days, (FIRST, LATER), strict=True)))
    rows: list[tuple[object, ...]] = [(day, when, "", distance * 0.0254, angle, speed) for day, when, points in
                                      zip("ab", days, (FIRST, LATER), strict=True) for angle, speed, distance in points]
    table = import_3476(write(tmp_path / "h.csv", HISTORY, rows))
    dataset = import_3476(clone)
    assert without_names(dataset) == without_names(table)
    assert dataset.shots.number("t_s").tolist() == [0.0, 0.0, 86400.0]
    assert dataset.left_out == table.left_out == ("1 set points that a version left as they were",)
    assert truearc.main(["import", "frc-3476", str(clone), "-o", str(tmp_path / "d")]) == 0
    assert "3 shots" in capsys.readouterr().out


def test_a_commit_that_took_the_file_away_is_no_version(tmp_path: Path) -> None:
    clone = clone_of(tmp_path / "c", [("2021-11-01T00:00:00+00:00", FIRST)])
    commit(clone, None, "2021-11-02T00:00:00+00:00")
    commit(clone, json.dumps({"shooterConfigs": [config(*point) for point in LATER]}), "2021-11-03T00:00:00+00:00")
    assert len(set(import_3476(clone).shots.text("version"))) == 2


def test_what_is_no_history_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clone = clone_of(tmp_path / "c", [("2021-11-01T00:00:00+00:00", FIRST), ("2021-11-02T00:00:00+00:00", LATER)])
    with pytest.raises(InputError, match="its history has no src/main/deploy"):
        import_3476(clone / "src")
    git(tmp_path, "clone", "--quiet", "--depth", "1", f"file://{clone}", "shallow")
    with pytest.raises(InputError, match=r"shallow: is a shallow clone.*fetch --unshallow"):
        import_3476(tmp_path / "shallow")
    commit(clone, '{"shooterConfigs": [\n{"distance": 80, "hoodEjectAngle": "steep", "flywheelSpeed": 1}]}',
           "2021-11-03T00:00:00+00:00")
    name = git(clone, "log", "-1", "--abbrev=7", "--format=%h").strip()
    with pytest.raises(InputError, match=rf"json of {name}:2: hood_eject_angle_deg: 'steep' is not a finite number"):
        import_3476(clone)
    (tmp_path / "none").mkdir()
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path))
    with pytest.raises(InputError, match="not a git repository"):
        import_3476(tmp_path / "none")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InputError, match="needs git"):
        import_3476(clone)


@pytest.mark.data
def test_the_real_history_is_the_same_out_of_a_clone(tmp_path: Path, data_dir: Path) -> None:
    table = data_dir / "real/frc3476_tuning_history.csv"
    versions: dict[str, list[Point]] = {}
    with table.open(newline="") as file:
        for row in csv.DictReader(file):
            point = (float(row["hood_eject_angle_deg"]), float(row["flywheel_rpm"]), float(row["distance_in"]))
            versions.setdefault(row["committed_at"], []).append(point)
    clone = clone_of(tmp_path / "c", list(reversed(versions.items())))
    ours, theirs = without_names(import_3476(clone)), without_names(import_3476(table))
    for mine, other in zip(ours, theirs, strict=True):
        assert mine == pytest.approx(other, abs=1e-4)
