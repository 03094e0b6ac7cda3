"""Every option of every command is used by the command's code or refused by name; none is ignored."""

import argparse
import inspect
import re
from importlib import import_module
from pathlib import Path

import pytest

from truearc.cli.main import Command, list_commands, main, make_parser

ALWAYS = {"help", "force"}            # of every command, and of every one with outputs (test_outputs.py)
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


@pytest.mark.parametrize(("words", "why"), [
    ("predict DIR --gate g.onnx --cd 0", "--cd: does not apply with --gate"),
    ("follow DIR --belief BELIEF --once --every 7", "--every: does not apply with --once"),
    ("emulate --bus slcan:auto --trials 1 --quiet", "--quiet: does not apply with --bus")])
def test_an_option_that_does_not_apply_is_refused_even_if_it_is_zero(words: str, why: str,
                                                                      capsys: pytest.CaptureFixture[str]) -> None:
    root = Path(__file__).parents[2]
    belief = next((root / "tests" / "golden" / "reference" / "belief").rglob("*.toml"))
    places = {"DIR": str(root / "examples" / "spreadsheet"), "BELIEF": str(belief)}
    assert main([places.get(word, word) for word in words.split()]) == 2
    assert why in capsys.readouterr().err


@pytest.mark.parametrize(("words", "option"), [
    ("predict d --gate g.onnx --cd 1", "--cd"), ("predict d --gate g.onnx --coefficients c", "--coefficients"),
    ("fit d --seed 1", "--seed"), ("paper fit d --seed 1", "--seed: there is no such option"),
    ("paper fit d --terms drag", "--terms: there is no such option"),
    ("identifiability r.toml --false-alarm 0.1", "--false-alarm: there is no such option"),
    ("discover d --level L1", "--level: there is no such option"),
    ("doctor --config c --core 1", "--core: there is no such option"),
    ("paper train --real r --lambda 0.1 -o w", "--lambda"),
    ("paper train --real r --validation 0 --patience 9 -o w", "--patience"),
    ("paper sweep --real r --sizes 0 --lambdas 0.1 -o w", "--lambdas"),
    ("paper sweep --real r --sizes 0 --sim s -o w", "--sim"),
    ("vision-calibrate a.jpg --board chessboard:9x6:0.025 --tape-sigma 0.1", "--tape-sigma"),
    ("vision-calibrate a.jpg --board chessboard:9x6:0.025 --bias-sigma 0.1", "--bias-sigma"),
    ("sysid s --config c.toml", "--config"), ("sysid --csv a.csv --only hood", "--only"),
    ("sysid --config c.toml --world w.toml", "--world"), ("sysid --config c.toml --seed 1", "--seed"),
    ("emulate --trials 1 --out s --watchdog-ms 50", "--watchdog-ms"),
    ("emulate --trials 1 --bus slcan:auto --out s", "--out"),
    ("emulate --trials 1 --bus slcan:auto --gate g", "--gate"),
    ("emulate --trials 1 --bus slcan:auto --page 0", "--page"),
    ("session replay s --from frames --config c.toml", "--config"),
    ("session replay s --from frames --gate g", "--gate"),
    ("discover d --since e", "--since"), ("discover d --belief b --believe drag", "--belief"),
    ("prove grade --worlds 3", "--worlds"), ("prove solve --packed p", "--packed"),
    ("prove pack --packed p --so-far", "--so-far"),
], ids=str)
def test_an_option_of_another_mode_or_command_is_refused_by_name(words, option, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(words.split()) == 2
    assert f": {option}" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_every_option_has_a_help_text() -> None:
    for command in list_commands():
        for action in make_parser(command)._actions:
            assert action.help and action.help is not argparse.SUPPRESS, f"{command.name}: {action.dest}"
