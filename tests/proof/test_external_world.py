"""Somebody else's world: what could never be marked is refused before it is sealed, and the seal can be checked by
hand."""

import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec
import pytest

from truearc.errors import InputError
from truearc_proof.rounds import Room
from truearc_proof.rounds.committer import seal_own
from truearc_proof.rounds.worlds import Drawn, make_data

DOCS = Path(__file__).parents[2] / "docs" / "how-to" / "challenge.md"
WIND: dict[str, Any] = {"kind": "one", "effects": {"wind_x": 2.0}}


@pytest.fixture(scope="module")
def shots(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("own") / "challenge"
    make_data(Drawn("challenge", "numpy", "clean", "L0", 12, 5), directory)
    return directory


def seal(folder: Path, truth: dict[str, Any], data: Path) -> str:
    (folder / "truth.json").write_bytes(msgspec.json.encode(truth))
    return seal_own(Room(folder / "round"), folder / "truth.json", data)


@pytest.mark.parametrize(("truth", "said"), [
    ({"kind": "one"}, "effects: there are 0; kind 'one' has 1"),
    ({"kind": "one", "effects": {"wind_x": 1.0, "wind_y": 1.0}}, "effects: there are 2"),
    ({"kind": "clean", "effects": {"wind_x": 1.0}}, "effects: there are 1; kind 'clean' has none"),
    ({"kind": "off"}, "kind 'off' has 1 or more"),
    ({"kind": "one", "effects": {"windx": 1.0}}, "windx: the catalogue has no such term"),
    ({"kind": "one", "effects": {"gravity": 1.0}}, "gravity: claims about this term cannot be marked"),
    ({"kind": "off", "effects": {"wind_x": 1.0}}, "wind_x: is in the catalogue"),
    ({"kind": "one", "effects": {"wind_x": 0.0}}, "wind_x: 0 is nothing"),
    ({"kind": "one", "effects": ["wind_x"]}, r"effects"),
    ({"effects": {"wind_x": 1.0}}, "kind")])
def test_a_truth_that_can_never_be_marked_is_refused_by_file_and_key(tmp_path: Path, shots: Path,
                                                                     truth: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=rf"truth\.json: .*{said}"):
        seal(tmp_path, truth, shots)
    assert not (tmp_path / "round").exists()


def test_reserved_names_too_few_shots_and_nothing_to_believe_are_refused(tmp_path: Path, shots: Path) -> None:
    shutil.copytree(shots, tmp_path / "home")
    with pytest.raises(InputError, match="home: a world cannot be called 'home'"):
        seal(tmp_path, WIND, tmp_path / "home")
    for name in ("few", "blank"):
        shutil.copytree(shots, tmp_path / name)
    table = tmp_path / "few" / "shots.csv"
    table.write_text("".join(table.read_text().splitlines(keepends=True)[:8]))
    with pytest.raises(InputError, match=r"shots\.csv: 7 shots; discovery takes 10 at least"):
        seal(tmp_path, WIND, tmp_path / "few")
    facts = tmp_path / "blank" / "rig.toml"
    facts.write_text(re.sub(r"(?ms)^\[believe\]\n.*?(?=^\[|\Z)", "", facts.read_text()) + "\n[believe]\nterms = []\n")
    with pytest.raises(InputError, match=r"rig\.toml: believe: terms"):
        seal(tmp_path, WIND, tmp_path / "blank")


def test_a_kill_between_the_ledger_and_the_data_is_made_good_with_the_sealed_data_alone(tmp_path: Path,
                                                                                         shots: Path) -> None:
    room = Room(tmp_path / "round")
    told = seal(tmp_path, WIND, shots)
    shutil.rmtree(room.data("challenge"))        # entered, and not given away yet
    other = tmp_path / "other" / "challenge"
    shutil.copytree(shots, other)
    (other / "notes.txt").touch()
    with pytest.raises(InputError, match=r"notes\.txt: was not among the sealed data"):
        seal(tmp_path, WIND, other)
    assert not room.data("challenge").exists()
    assert seal(tmp_path, WIND, shots) == told and room.steps() == {"challenge": {"sealed": told}}
    assert room.data("challenge").is_dir()


def test_the_line_by_which_anybody_checks_a_seal_gives_the_number_that_was_told(tmp_path: Path, shots: Path) -> None:
    told = seal(tmp_path, WIND, shots)
    (program,) = re.findall(r"python -c '(.*)' round/keeper/challenge\.json", DOCS.read_text(encoding="utf-8"))
    done = subprocess.run([sys.executable, "-c", program, "round/keeper/challenge.json"], cwd=tmp_path,
                          capture_output=True, text=True, check=True)
    assert done.stdout.strip() == told
