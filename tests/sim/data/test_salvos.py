"""Rows of shots.csv that state how many of several balls scored."""

import shutil
from pathlib import Path

import pytest

from truearc.cli.main import main
from truearc.errors import InputError
from truearc.sim.data.dataset import Dataset
from truearc.sim.data.files import load_dataset

HEAD = "shot_id,distance_m,hood_deg,motor_ratio,fired,hits,outcome,side\n"


def loaded(home: Path, *rows: str) -> Dataset:
    shutil.rmtree(home / "d", ignore_errors=True)
    assert main(["init", "--game", "frc-2026", str(home / "d")]) == 0
    rig = (home / "d" / "rig.toml").read_text()
    rig = rig.replace("free_speed_rad_s = nan", "free_speed_rad_s = 594.0").replace("= nan", "= 0.05")
    (home / "d" / "rig.toml").write_text(rig)
    (home / "d" / "shots.csv").write_text(HEAD + "\n".join(rows) + "\n")
    return load_dataset(home / "d")


def test_each_ball_of_a_salvo_becomes_a_shot(tmp_path: Path) -> None:
    shots = loaded(tmp_path, "a,3.0,60,0.5,5,3,,", "b,2.0,62,0.4,,,miss,short", "c,2.0,62,0.4,1,1,,").shots
    assert shots.shot_id == ("a.1", "a.2", "a.3", "a.4", "a.5", "b", "c")
    assert shots.text("outcome") == ("two", "two", "two", "miss", "miss", "miss", "two")
    assert shots.text("side")[5] == "short" and shots.number("distance_m").tolist() == [3.0] * 5 + [2.0] * 2
    assert "fired" not in shots.numbers and "hits" not in shots.numbers


@pytest.mark.parametrize(("row", "message"), [
    ("a,3.0,60,0.5,3,4,,", "hits: 4 of fired 3: both are whole numbers, hits at most fired"),
    ("a,3.0,60,0.5,2.5,1,,", "hits: 1 of fired 2.5"),
    ("a,3.0,60,0.5,3,,,", "hits: nan of fired 3"),
    ("a,3.0,60,0.5,3,1,two,", "outcome: stands beside fired and hits"),
])
def test_salvos_that_cannot_be_are_named(tmp_path: Path, row: str, message: str) -> None:
    with pytest.raises(InputError, match=message.replace("(", r"\(")):
        loaded(tmp_path, row)
