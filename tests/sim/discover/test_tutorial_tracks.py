"""The figures of docs/tutorials/tracks.md: flights that examples/tracks/make.py computes without truearc."""

import re
import runpy
from pathlib import Path

import pytest

import truearc as ta

ROOT = Path(__file__).parents[3]
EXAMPLE = ROOT / "examples" / "tracks"


def test_tracks_are_those_of_the_script(tmp_path: Path) -> None:
    make = runpy.run_path(str(EXAMPLE / "make.py"))
    make["main"](tmp_path)
    for name in ("shots.csv", "tracks.csv"):
        assert (tmp_path / name).read_text(encoding="utf-8") == (EXAMPLE / name).read_text(encoding="utf-8")


@pytest.mark.slow
def test_lift_is_named_with_the_coefficient_of_the_script() -> None:
    make = runpy.run_path(str(EXAMPLE / "make.py"))
    page = (ROOT / "docs" / "tutorials" / "tracks.md").read_text(encoding="utf-8")
    low, high = map(float, re.findall(r"coefficient of 0\.098 \(90 %: ([\d.]+) to ([\d.]+)\)", page)[0])
    found = ta.discover(ta.load_dataset(EXAMPLE), believe=["gravity", "drag"], seed=0)
    assert found.verdict == "named" and found.best.term == "magnus"
    assert found.best.interval90 == pytest.approx((low, high), abs=6e-4)
    assert low < make["CL"] < high
