"""A file that is given to the wrong command is named with the command to use; nothing ends in a traceback."""

import re
import shutil
from argparse import ArgumentTypeError
from pathlib import Path

import pytest

from truearc.cli.aim import parse_distances
from truearc.cli.file_kinds import ARGUMENTS, KINDS, kind_of
from truearc.cli.main import NAMES, main
from truearc.sim.data.importers import load_importers

ROOT = Path(__file__).parents[2]
LOOPS = "Timestamp,v\n" + "".join(f"{k / 50},{k}\n" for k in range(30))
# name -> (its kind, what a command that takes none of that kind ends in)
GIVEN = {
    "wind.csv": ("table", "truearc import csv wind.csv --guess --rig rig.toml -o DIR"),
    "loops.csv": ("table", "truearc import csv loops.csv --guess --rig rig.toml -o DIR"),
    "mine.xlsx": ("table", "truearc import csv mine.xlsx --guess --rig rig.toml -o DIR"),
    "mine.ods": ("workbook", "truearc import csv FILE.xlsx --guess --rig rig.toml -o DIR"),
    "alone.toml": ("rig", "truearc identifiability alone.toml"),
    "launcher.toml": ("launcher", "truearc doctor --config launcher.toml"),
    "gate.onnx": ("gate", "truearc serve gate.onnx"),
    "monday": ("session", "truearc shots monday -o DIR"),
    "data": ("dataset", "truearc check data"),
    "finding.json": ("finding", "truearc discover DIR --adopt coefficients.toml"),
    "belief.toml": ("coefficients", "truearc aim belief.toml --rig rig.toml"),
    "shots.toml": ("shot-map", "truearc import csv FILE.csv --map shots.toml --rig rig.toml -o DIR"),
    "a.wpilog": ("wpilog", "truearc import wpilog a.wpilog --guess --rig rig.toml -o DIR"),
    "a.mcap": ("mcap", "truearc shots SESSION -o DIR"),
    "empty.csv": ("empty", ""), "folder": ("folder", ""), "junk": ("file", "")}
# command line with X -> the kinds that X may be, and what makes one
LINES = {
    "import csv X --guess --rig data/rig.toml -o out": (("table",), "init DIR"),
    "import csv wind.csv --map X --rig data/rig.toml -o out": (("shot-map",), ""),
    "import csv wind.csv --guess --rig X -o out": (("rig",), "init DIR"),
    "shots X -o out": (("session",), "emulate --out X"), "check X": (("dataset",), "init X"),
    "fit data --terms-from X": (("python",), ""), "vision X": (("picture", "empty"), ""),
    "vision-calibrate --board chessboard:9x6:0.025 X": (("picture",), ""),
    "fit X -o out": (("dataset",), "init X"), "discover X": (("dataset",), "init X"),
    "discover data --belief X": (("coefficients",), "fit DIR -o X"), "design X": (("dataset",), "init X"),
    "predict X --cd 1 --cl 1": (("dataset",), "init X"), "predict data --gate X": (("gate",), "export WEIGHTS -o X"),
    "aim X --rig data/rig.toml": (("coefficients",), "fit DIR -o X"),
    "aim belief.toml --rig X": (("rig", "launcher"), "init DIR"),
    "identifiability X": (("rig", "launcher", "dataset"), "init DIR"),
    "train --real X --coefficients belief.toml -o out": (("dataset",), "init X"),
    "export X -o out": (("weights",), "train --real DIR --coefficients coefficients.toml -o X"),
    "verify X": (("gate", "aim"), "export WEIGHTS -o X"), "serve X": (("gate",), "export WEIGHTS -o X"),
    "run --config X": (("launcher",), "init --robot X"), "doctor --config X": (("launcher",), "init --robot X"),
    "sysid X": (("session",), "emulate --out X"), "session replay X": (("session",), "emulate --out X"),
    "session convert X --to mcap -o out": (("session",), "emulate --out X"),
    "paper fit X -o out": (("dataset",), "init X"),
    "paper synth --rig X --coefficients belief.toml -n 9 -o out": (("rig",), "init DIR")}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    home, golden = tmp_path_factory.mktemp("files"), ROOT / "tests/golden"
    shutil.copytree(ROOT / "examples/spreadsheet", home / "data")
    for source, name in ((ROOT / "examples/spreadsheet/rig.toml", "alone.toml"),
                         (ROOT / "robot/launcher.toml", "launcher.toml"),
                         (golden / "reference/export-network/gate.onnx", "gate.onnx"),
                         (golden / "reference/finding-l0-null/finding.json", "finding.json"),
                         (golden / "inputs/coefficients.toml", "belief.toml"),
                         (ROOT / "robot/config/maps/ftc-csv.toml", "shots.toml")):
        shutil.copy(source, home / name)
    for name, data in (("wind.csv", b"a,b\n1,2\n"), ("loops.csv", LOOPS.encode()), ("mine.xlsx", b"PK\x03\x04"),
                       ("mine.ods", b"PK\x03\x04"),
                       ("a.wpilog", b"WPILOG\x00\x01"), ("a.mcap", b"\x89MCAP0\r\n"), ("empty.csv", b""),
                       ("junk", b"\x01\x02\xff")):
        (home / name).write_bytes(data)
    for name in ("folder", "monday"):
        (home / name).mkdir()
    (home / "monday" / "session.json").write_text("{}")
    return home


def test_a_file_is_known_by_what_it_holds(files: Path) -> None:
    assert {name: kind_of(files / name) for name in GIVEN} == {name: kind for name, (kind, _) in GIVEN.items()}
    assert kind_of(files / "nowhere") == ""


@pytest.mark.parametrize("line", LINES)
def test_each_file_given_to_each_command(line, files, monkeypatch, capsys):
    monkeypatch.chdir(files)
    takes, made = LINES[line]
    for name, (kind, use) in GIVEN.items():
        own_words = kind == "file" or (kind == "folder" and {"dataset", "session"} & {*takes})     # of the command
        if kind in takes or own_words:
            continue
        assert main([name if word == "X" else word for word in line.split()]) == 2
        said = capsys.readouterr().err.strip().removeprefix(f"truearc {line.split(' X')[0].split(' --')[0]}: ")
        assert f"{name}: is a" in said or f"{name}: is the" in said
        use = "" if kind == "table" and made == "init DIR" else use
        if line.startswith("import") and "--rig X" not in line:
            use = use.replace("-o DIR", "-o out").replace("--rig rig.toml", "--rig data/rig.toml")
        assert said.endswith(use or f"truearc {made.replace('X', 'NEW')}" if use or made else " is expected"), said
        assert "\n" not in said


@pytest.mark.parametrize(("source", "name", "said"), [
    ("frc-254", "wind.csv", "are missing\n"), ("ftc-decode", "mine.xlsx", "takes SHOTS.csv; not mine.xlsx\n")])
def test_a_table_given_as_a_teams_recording_ends_in_the_import_of_any_table(source, name, said, files, monkeypatch,
                                                                            capsys):
    if source not in {one.name for one in load_importers()}:
        pytest.skip("truearc-proof is not installed")
    monkeypatch.chdir(files)
    assert main(["import", source, name, "-o", "out"]) == 2
    assert capsys.readouterr().err.endswith(
        f"{said}For a file of your own: truearc import csv {name} --guess --rig rig.toml -o out\n")


# check takes seconds to load, and run waits for a robot's bus
@pytest.mark.parametrize("line", [line for line in LINES if LINES[line][1] and "data" not in line
                                  and not line.startswith(("check", "run"))])
def test_a_missing_file_ends_in_the_command_that_makes_it(line, files, monkeypatch, capsys):
    monkeypatch.chdir(files)
    assert main(["nowhere" if word == "X" else word for word in line.split()]) == 2
    said = capsys.readouterr().err.strip()
    assert "nowhere: there is no such f" in said and said.endswith("truearc " + LINES[line][1].replace("X", "nowhere"))


def test_the_files_of_a_dataset_lead_to_its_folder(files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("rig.toml", "shots.csv"):
        assert main(["discover", str(files / "data" / name)]) == 2
        assert capsys.readouterr().err.endswith(f"name the folder that it is in: truearc discover {files / 'data'}\n")


def test_what_is_known_of_files_is_of_commands_that_exist() -> None:
    assert all(kind in KINDS for kinds in ARGUMENTS.values() for kind in kinds)
    known = [kind[word] for kind in KINDS.values() for word in ("use", "make") if word in kind]
    for line in known:
        words = line.removeprefix("truearc ").split()
        assert words[0] in NAMES or " ".join(words[:2]) in NAMES


@pytest.mark.parametrize(("text", "hint"), [
    ("8-20ft", "8:20:2ft"), ("8 to 20 ft", "8:20:2ft"), ("2-5", "2:5:0.5"), ("2..5m", "2:5:0.5m"),
    ("8–20ft", "8:20:2ft")])
def test_a_range_in_other_words_is_answered_with_its_form(text: str, hint: str) -> None:
    with pytest.raises(ArgumentTypeError, match=f"--distances {hint}"):
        parse_distances(text)
    assert len(parse_distances(hint)) == 7


def test_a_refusal_of_written_data_ends_in_the_command_that_checks_them(files, tmp_path, capsys):
    data = shutil.copytree(files / "data", tmp_path / "data")
    rig = (data / "rig.toml").read_text(encoding="utf-8")
    (data / "rig.toml").write_text(re.sub(r"(?m)^mass_kg = .*", "mass_kg = 270.0", rig), encoding="utf-8")
    assert main(["check", str(data)]) == 2
    assert capsys.readouterr().err.endswith(f"Correct the file, and run: truearc check {data}\n")
