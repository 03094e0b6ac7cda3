"""Importing a part of the shots, and what the import says cannot be as it was written down."""

import csv
from pathlib import Path

import numpy as np
import pytest

import truearc.cli.main as truearc
from truearc.sim.data.files import load_dataset
from truearc.sim.data.importers.imported import doubts_of
from truearc_proof.importers.set_points import import_254, import_3476

HISTORY = ("commit", "committed_at", "distance_m", "hood_eject_angle_deg", "flywheel_rpm")
NEAR_M, LOWER_RIM_M = 1.5, 2.4956 - 0.381 - 0.75
STEEP_DEG = float(np.degrees(np.arctan2(LOWER_RIM_M, NEAR_M)))
DAY = "2021-11-0{}T00:00:00+00:00"


def history(folder: Path, *near_deg: float) -> Path:
    """One version for each elevation of the nearest set point."""
    path = folder / "history.csv"
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([HISTORY, *(("abc"[k], DAY.format(k + 1), NEAR_M, deg, 4500)
                                               for k, deg in enumerate(near_deg))])
    return path


def test_an_elevation_below_the_line_of_sight_is_doubted_and_imported(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flat = history(tmp_path, STEEP_DEG + 0.5, STEEP_DEG - 0.5, STEEP_DEG - 8.0)
    assert truearc.main(["import", "frc-3476", str(flat), "-o", str(tmp_path / "d")]) == 0
    said = capsys.readouterr().out
    assert "warning: 2 of 3 shots leave flatter than a straight line to the opening's lower rim" in said
    assert f"c-002 at 1.50 m has {STEEP_DEG - 8.0:.1f} deg, where {STEEP_DEG:.1f} are the least" in said
    assert len(load_dataset(tmp_path / "d").shots) == 3
    assert doubts_of(import_3476(history(tmp_path, STEEP_DEG + 0.1))) == ()


def test_only_some_of_the_shots(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = history(tmp_path, 50.0, 51.0, 52.0), tmp_path / "d"

    def imported(wanted: str) -> int:
        return truearc.main(["import", "frc-3476", str(path), "--only", wanted, "-o", str(out), "--force"])

    assert imported("version=a,c") == 0
    assert load_dataset(out).shots.number("hood_deg").tolist() == [50.0, 52.0]
    assert imported("version=d") == 2
    assert "no shot has 'd' as its version; there are 'a', 'b', 'c'" in capsys.readouterr().err
    for wanted in ("version", "hood_deg=50"):
        assert imported(wanted) == 2
        assert "is not COLUMN=TEXT with one of the columns version" in capsys.readouterr().err


@pytest.mark.data
def test_of_the_real_set_points_only_3476s_are_too_flat(data_dir: Path) -> None:
    assert doubts_of(import_254(data_dir / "real/frc_shot_tables.csv")) == ()
    (line,) = doubts_of(import_3476(data_dir / "real/frc3476_tuning_history.csv"))
    assert "of 55 shots" in line
