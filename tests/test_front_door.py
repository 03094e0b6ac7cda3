"""The front door: every verb explains itself, and a user's mistake is never a traceback."""

import subprocess
import sys

import pytest

from truearc.cli.main import VERBS, main


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_has_help_with_an_example(verb, capsys):
    with pytest.raises(SystemExit) as stop:
        main([*verb.split(), "--help"])
    assert stop.value.code == 0
    said = capsys.readouterr().out
    assert f"usage: truearc {verb}" in said and f"truearc {verb} " in said.partition("example:")[2]


def test_no_verb_and_an_unknown_one_list_the_verbs(capsys):
    for words in ([], ["lunch"]):
        assert main(words) == 2
        assert "discover" in capsys.readouterr().err
    assert main(["--help"]) == 0


@pytest.mark.parametrize("words", [
    ["replay", "nowhere"], ["recover", "nowhere"], ["convert", "nowhere", "--to", "csv", "-o", "x.csv"],
    ["shots", "nowhere", "-o", "d"], ["predict", "nowhere", "--cd", "1", "--cl", "0"],
    ["fit", "nowhere"], ["train", "--real", "nowhere", "-o", "w"], ["export", "nowhere", "-o", "g.onnx"],
    ["verify", "nowhere.onnx"], ["predict-gate", "nowhere.onnx", "nowhere"], ["discover", "nowhere"],
    ["synth", "--rig", "nowhere.toml", "--coefficients", "nowhere.toml", "-o", "d"], ["vision", "nowhere.jpg"],
    ["import", "mpi", "nowhere.csv", "nowhere.csv", "-o", "d"], ["run", "--config", "nowhere.toml"],
    ["emulate", "--trials", "1", "--out", "s", "--config", "nowhere.toml"],
    ["emulate", "--trials", "1", "--out", "s", "--world", "nowhere.toml"],
    ["emulate", "--trials", "0", "--out", "s"], ["emulate", "--trials", "1", "--out", "s", "--gate", "nowhere.onnx"],
])
def test_what_is_not_there_is_named_with_exit_code_2(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main([*words, "--quiet"]) == 2
    said = capsys.readouterr().err
    assert "nowhere" in said or "--trials 0" in said


@pytest.mark.parametrize("words", [
    ["emulate", "--trials", "1", "--out", "s", "--seed", "-1"], ["demo", "--seed", "-1"], ["demo", "--trials", "3"],
    ["emulate", "--trials", "1", "--out", "a_file/s"], ["demo", "--out", "a_file"],
])
def test_options_that_cannot_be_are_told_and_leave_nothing_behind(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a_file").touch()
    assert main([*words, "--quiet"]) == 2
    assert capsys.readouterr().err.startswith(f"truearc {words[0]}: ")
    assert [path.name for path in tmp_path.iterdir()] == ["a_file"]


def test_without_the_companion_a_verb_says_what_to_install():
    code = "import sys; sys.modules['jax'] = None\nfrom truearc.cli.main import main\nsys.exit(main(['fit', 'x']))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 2 and "truearc[sim]" in done.stderr and "Traceback" not in done.stderr


def test_a_reader_that_stops_reading_is_no_error():
    done = subprocess.run([sys.executable, "-m", "truearc", "--help"], capture_output=True, text=True)
    assert done.returncode == 0 and "emulate" in done.stdout
