"""One rule for outputs: what exists is refused and stays as it was; `--force` replaces it."""

import shutil
from pathlib import Path

import pytest

from truearc.cli.main import main
from truearc.cli.outputs import OutFolder, out_file
from truearc.cli.parsers import make_parser
from truearc.cli.registry import Command, list_commands

SHOTS = Path(__file__).parents[2] / "examples" / "spreadsheet"
OWN_RULE = {"run": "--out", "emulate": "--out", "sysid": "--out", "prove": "--out", "reproduce": "--out",
            "vision-tune": "--out", "doctor": "--out"}    # sessions, rounds, a page that saves on request, a check


NAMES = ("-o", "--out", "--json", "--report", "--adopt", "--map", "--picture", "--tied", "--reliability")


@pytest.mark.parametrize("command", list_commands(), ids=lambda command: command.name)
def test_every_output_follows_the_rule(command: Command) -> None:
    actions = {option: action for action in make_parser(command)._actions for option in action.option_strings}
    for option in set(NAMES) & set(actions):
        if OWN_RULE.get(command.name) not in actions[option].option_strings and actions[option].nargs != 0:
            assert actions[option].type is out_file or isinstance(actions[option].type, OutFolder), option
            assert "--force" in actions


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder that the commands of a test run in, with a dataset `week`."""
    shutil.copytree(SHOTS, tmp_path / "week")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("words", [
    "predict week --cd 0.5 --cl 0.1 -o old", "fit week -o old", "discover week --report old",
    "discover week --json old",
    "discover week --adopt old", "design week --json old", "identifiability week --report old", "export w -o old",
    "paper fit week -o old", "paper fit week --map old", "session convert s --to csv -o old", "sysid s -o old",
    "sysid s --report old", "vision-calibrate --distances t.csv -o old", "train --real week --coefficients c -o w "
    "--reliability old"])
def test_an_existing_file_is_refused_and_kept(words: str, here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "old").write_text("kept")
    assert main(words.split()) == 2
    assert "old: exists already; name another, or replace it with --force" in capsys.readouterr().err
    assert (here / "old").read_text() == "kept"


def test_force_replaces_a_file(here: Path) -> None:
    (here / "old").write_text("kept")
    assert main(["predict", "week", "--cd", "0.5", "--cl", "0.1", "-o", "old", "--force"]) == 0
    assert (here / "old").read_text().startswith("shot_id,")


def test_a_device_is_written_to(here: Path) -> None:
    assert main(["predict", "week", "--cd", "0.5", "--cl", "0.1", "-o", "/dev/null"]) == 0


SYNTH = ["paper", "synth", "--rig", "week/rig.toml", "--coefficients", "c.toml", "-n", "9", "-o", "made", "--quiet"]


def test_a_folder_is_replaced_by_force_alone(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["paper", "fit", "week", "--step", "0.5", "-o", "c.toml", "--quiet"]) == 0
    assert main(SYNTH) == 0
    before = (here / "made" / "shots.csv").read_bytes()
    assert main([*SYNTH, "--seed", "5"]) == 2
    assert "made: is not empty; name another, or replace it with --force" in capsys.readouterr().err
    assert (here / "made" / "shots.csv").read_bytes() == before
    assert main([*SYNTH, "--seed", "5", "--force"]) == 0
    assert (here / "made" / "shots.csv").read_bytes() != before
    assert sorted(path.name for path in here.iterdir()) == ["c.toml", "made", "week"]


def test_a_folder_stays_when_the_command_fails(here: Path) -> None:
    (here / "made").mkdir()
    (here / "made" / "shots.csv").write_text("kept")
    assert main([*SYNTH, "--force"]) == 2            # there is no c.toml
    assert (here / "made" / "shots.csv").read_text() == "kept"
    assert sorted(path.name for path in here.iterdir()) == ["made", "week"]


def test_a_folder_with_anything_else_in_it_is_never_replaced(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for out in (["shots", "s", "-o", "week"], ["demo", "--out", "week"]):
        (here / "week" / "notes.txt").write_text("mine")
        assert main([*out, "--force"]) == 2
        assert "which this command does not write; name another folder" in capsys.readouterr().err
    assert (here / "week" / "notes.txt").read_text() == "mine"
