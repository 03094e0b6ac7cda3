"""Options are used or refused by name; what an output names is refused where it exists, or replaced."""

import inspect
import os
import re
import shlex
import shutil
import sys
from importlib import import_module
from pathlib import Path

import pytest

from truearc.cli.common import OutFolder, out_file
from truearc.cli.main import Command, list_commands, main, make_parser
from truearc.errors import InputError, save_whole, whole_file

SHOTS = Path(__file__).parents[2] / "examples" / "spreadsheet"
# sessions, rounds, a check; a map that is an input
OWN_RULE = {**{name: {"--out"} for name in ("run", "emulate", "sysid", "prove", "reproduce")},
            "advise": {"--out", "--map"}, "import": {"--map"}, "doctor": {"--out", "--map"}}


NAMES = ("-o", "--out", "--json", "--report", "--adopt", "--map", "--picture", "--tied", "--reliability")


@pytest.mark.parametrize("command", list_commands(), ids=lambda command: command.name)
def test_every_output_follows_the_rule(command: Command) -> None:
    actions = {option: action for action in make_parser(command)._actions for option in action.option_strings}
    for option in set(NAMES) & set(actions):
        own = OWN_RULE.get(command.name, set()) & set(actions[option].option_strings)
        if not own and actions[option].nargs != 0:
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
    "discover week --json old", "discover week --adopt old", "design week --json old",
    "identifiability week --report old", "export w -o old",
    "paper fit week -o old", "paper fit week --map old", "session convert s --to csv -o old", "sysid s -o old",
    "sysid s --report old", "vision-calibrate --distances t.csv -o old", "train --real week --coefficients c -o w "
    "--reliability old", "vision-tune week -o old", "init --robot old"])
def test_an_existing_file_is_refused_and_kept(words: str, here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "old").write_text("kept")
    assert main(words.split()) == 2
    assert "old: exists already; name another, or replace it with --force" in capsys.readouterr().err
    assert (here / "old").read_text() == "kept"


def test_two_outputs_are_not_one_file(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["discover", "week", "--json", "x.html", "--report", "./x.html"]) == 2
    assert "--json, --report: both write x.html; name two" in capsys.readouterr().err
    assert not (here / "x.html").exists()


def test_force_replaces_a_file(here: Path) -> None:
    (here / "old").write_text("kept")
    assert main(["predict", "week", "--cd", "0.5", "--cl", "0.1", "-o", "old", "--force"]) == 0
    assert (here / "old").read_text().startswith("shot_id,")


@pytest.mark.skipif(sys.platform == "win32", reason="devices: POSIX only")
@pytest.mark.parametrize("force", [[], ["--force"]])
def test_a_device_is_written_to_and_stays(force: list[str], here: Path) -> None:
    assert main(["predict", "week", "--cd", "0.5", "--cl", "0.1", "-o", "/dev/null", *force]) == 0
    assert Path("/dev/null").is_char_device()


@pytest.mark.skipif(sys.platform == "win32", reason="named pipes: POSIX only")
@pytest.mark.parametrize("words", [
    "predict week --cd 0.5 --cl 0.1 -o", "aim b --rig week/rig.toml --robot", "init --robot"])
@pytest.mark.parametrize("force", [[], ["--force"]])
def test_what_is_no_file_is_refused_and_stays(words, force, here, capsys):
    os.mkfifo(here / "pipe")
    assert main([*words.split(), "pipe", *force]) == 2
    assert "pipe: is a pipe or a device, not a file; name a file" in capsys.readouterr().err
    assert (here / "pipe").is_fifo()


@pytest.mark.parametrize("kind", [InputError, OSError, KeyboardInterrupt])
def test_a_file_stays_until_all_of_the_new_one_is_there(kind: type[BaseException], here: Path) -> None:
    (here / "old").write_text("kept")
    with pytest.raises(kind), whole_file(here / "old") as new:
        new.write_text("half")
        raise kind(5, f"{new} is wrong") if kind is OSError else kind(f"{new} is wrong")
    assert (here / "old").read_text() == "kept"
    assert sorted(path.name for path in here.iterdir()) == ["old", "week"]


def test_a_file_that_fails_its_check_is_called_by_the_name_that_was_asked_for(here: Path) -> None:
    with pytest.raises(InputError, match=r"^aim\.json: no good$"), whole_file("aim.json") as new:
        raise InputError(f"{new}: no good")


@pytest.mark.skipif(sys.platform == "win32", reason="links and rights: POSIX only")
def test_a_link_and_the_rights_of_a_file_stay(here: Path) -> None:
    (here / "old").write_text("was")
    (here / "old").chmod(0o600)
    (here / "link").symlink_to("old")
    save_whole(here / "link", b"is")
    assert (here / "link").is_symlink() and (here / "old").read_text() == "is"
    assert (here / "old").stat().st_mode & 0o777 == 0o600


SYNTH = ["paper", "synth", "--rig", "week/rig.toml", "--coefficients", "c.toml", "-n", "9", "-o", "made", "--quiet"]


def test_a_folder_is_replaced_by_force_alone(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copy(Path(__file__).parents[1] / "golden" / "inputs" / "coefficients.toml", here / "c.toml")
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


# --- every option is used or refused by name

ALWAYS = {"help", "force"}            # of every command, and of every one with outputs
PACKAGES = ("truearc.cli", "truearc_proof.cli", "truearc_frc")


@pytest.mark.parametrize("command", list_commands(), ids=lambda command: command.name)
def test_every_option_is_read_by_the_commands_code(command: Command) -> None:
    """In its own module, or in one of the commands' modules that this imports."""
    waiting, source, seen = [command.run.partition(":")[0]], "", set()
    while waiting:
        name = waiting.pop()
        if name.startswith(PACKAGES) and name not in seen:
            seen.add(name)
            text = inspect.getsource(import_module(name))
            source += text
            waiting += re.findall(r"^ *from (\S+) import", text, re.MULTILINE)
            waiting += [f"truearc.cli.{one}" for line in re.findall(r"^ *from truearc\.cli import (.*)", text, re.M)
                        for one in re.findall(r"(\w+)(?: as \w+)?(?:, |$)", line)]
    options = {action.dest for action in make_parser(command)._actions} - ALWAYS
    assert options and {name for name in options if not re.search(rf"\bargs\.{name}\b", source)} == set()


@pytest.mark.slow
@pytest.mark.parametrize("words", ["identifiability DIR --sides", "identifiability DIR --seed 0", "check DIR --seed 1"])
def test_options_of_planned_shots_are_refused_with_results(words: str, capsys: pytest.CaptureFixture[str]) -> None:
    sheet = str(Path(__file__).parents[2] / "examples" / "spreadsheet")
    assert main([*words.replace("DIR", sheet).split(), "--quiet"]) == 2
    assert "applies to planned shots only; these have results" in capsys.readouterr().err


REFERENCE = SHOTS.parents[1] / "tests" / "golden" / "reference"
PLACES = {"DIR": SHOTS, "RIG": SHOTS / "rig.toml", "BELIEF": next((REFERENCE / "belief").rglob("*.toml")),
          "GATE": REFERENCE / "export-physics" / "gate.onnx", "LAUNCHER": SHOTS.parents[1] / "robot" / "launcher.toml"}


@pytest.mark.parametrize(("words", "why"), [
    ("predict DIR --gate g.onnx --cd 0", "--cd: does not apply with --gate"),
    ("follow DIR --belief BELIEF --once --every 7", "--every: does not apply with --once"),
    ("emulate --bus slcan:auto --trials 1 --quiet", "--quiet: does not apply with --bus"),
    ("design d --shots 2 --configurations 3", "--configurations 3"), ("design d --seed -1", "--seed: got -1"),
    ("design d --false-alarm 0", "--false-alarm"), ("discover d --seed -1", "--seed: got -1"),
    ("discover d --false-alarm 2", "--false-alarm"), ("discover d --false-alarm 0.0004", "--false-alarm"),
    ("discover d --json nowhere/x.json", "nowhere/x.json: there is no such directory"),
    ("discover d --believe gravity,magic", "--believe"), ("discover d --since home", "--since goes with --belief"),
    ("identifiability RIG --shots 3", "too few"), ("identifiability RIG --believe magic", "'magic'"),
    ("identifiability RIG --seed -1", "--seed"), ("identifiability DIR --level L1", "--level: "),
    ("identifiability DIR --shots 30", "--shots: "),
    ("identifiability RIG --believe gravity,free_push", "unexplained effect"),
    ("fit DIR --terms drag,magnetism", "--terms: there is no term 'magnetism'"),
    ("fit DIR --terms wind", "there is no term 'wind' (did you mean 'wind_x' or 'wind_y' or 'wind_z'?)"),
    ("fit DIR --terms drga", "--terms: there is no term 'drga' (did you mean 'drag'?)"),
    ("fit DIR --terms ''", "--terms: got ''; expected at least one entry"),
    ("fit DIR --terms drag,drag", "--terms: got drag more than once; keep one"),
    ("fit DIR --terms ' , '", "--terms: got ' , '; expected at least one entry"),
    ("fit DIR --seed 1", "--seed: applies with several datasets only"), ("fit DIR --seed -1", "--seed: got -1"),
    ("fit DIR -o nowhere/at/all.toml", "nowhere/at/all.toml"),
    ("predict DIR --cd 0.9", "--cl is needed"), ("predict DIR --cd nan --cl 0", "--cd: got nan; expected at least 0"),
    ("predict DIR --cd 1 --cl 1 --coefficients x", "exclude each other"),
    ("predict DIR --coefficients nowhere.toml", "nowhere.toml"),
    ("predict DIR --cd 1 --cl 1 -o /nowhere/p.csv", "/nowhere/p.csv"),
    *((f"serve GATE --port 0 {option}", option.split()[0]) for option in (
        "--threshold 1.5", "--threshold nan", "--port 70000", "--host no.such.host.invalid")),
    ("serve GATE --port 0 --config nowhere.toml", "nowhere.toml"),
    ("sysid", "give --config"), ("sysid --emulate", "needs --out"), ("sysid --config nowhere.toml", "nowhere.toml"),
    ("sysid --csv nowhere.csv", "nowhere.csv"), ("sysid --emulate --out x --seed -1", "--seed: got -1"),
    ("sysid --csv a.csv -o no/such/gains.toml", "no such directory"),
    *((f"doctor --config LAUNCHER {option}", option.split()[0]) for option in (
        "--seconds 0", "--seconds nan", "--priority 0")),
    ("doctor --config LAUNCHER --endpoints nowhere.json", "nowhere.json"),
    ("vision-tune --port 70000 .", "no pictures"), ("vision-tune --camera none.toml", "none.toml"),
    *((f"run --config nowhere.toml {option}", option.split()[0]) for option in (
        "--priority 100", "--priority -1", "--core -1")),
    *((f"run --config LAUNCHER --out s --page={where}", f"--page {where}") for where in (
        "here", "127.0.0.1:", "127.0.0.1:70000", "-1", ""))])
def test_an_option_that_cannot_be_is_named(words, why, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main([str(PLACES.get(word, word)) for word in shlex.split(words)]) == 2
    assert why in capsys.readouterr().err and list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("words", "option"), [
    ("predict d --gate g.onnx --cd 1", "--cd"), ("predict d --gate g.onnx --coefficients c", "--coefficients"),
    ("fit d --seed 1", "--seed"), ("paper train --real r --lambda 0.1 -o w", "--lambda"),
    ("paper train --real r --validation 0 --patience 9 -o w", "--patience"),
    ("paper sweep --real r --sizes 0 --lambdas 0.1 -o w", "--lambdas"),
    ("paper sweep --real r --sizes 0 --sim s -o w", "--sim"),
    ("vision-calibrate a.jpg --board chessboard:9x6:0.025 --tape-sigma 0.1", "--tape-sigma"),
    ("sysid s --config c.toml", "--config"), ("sysid --csv a.csv --only hood", "--only"),
    ("sysid --config c.toml --world w.toml", "--world"), ("sysid --config c.toml --seed 1", "--seed"),
    ("emulate --trials 1 --out s --watchdog-ms 50", "--watchdog-ms"),
    ("emulate --trials 1 --bus slcan:auto --out s", "--out"),
    ("emulate --trials 1 --bus slcan:auto --gate g", "--gate"),
    ("emulate --trials 1 --bus slcan:auto --page 0", "--page"),
    ("session replay s --from frames --gate g", "--gate"),
    ("discover d --belief b --believe drag", "--belief"),
    ("prove grade --worlds 3", "--worlds"), ("prove solve --packed p", "--packed"),
    ("prove pack --packed p --so-far", "--so-far")], ids=str)
def test_an_option_of_another_mode_or_command_is_refused_by_name(words, option, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(words.split()) == 2
    assert f": {option}" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
