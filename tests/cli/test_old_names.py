"""Earlier spellings: those that other programs use still work and print the new one; the others are refused."""

import pytest

from truearc.cli.main import main
from truearc.cli.old_names import FORWARDED, RENAMED, forward
from truearc.cli.registry import NAMES


@pytest.mark.parametrize(("old", "new"), [
    ("fit d --method grid -o c.toml", "paper fit d -o c.toml"),
    ("fit --method=grid d --step 0.5", "paper fit d --step 0.5"),
    ("fit d --method ml -o c.toml", "fit d -o c.toml"),
    ("fit d -o c.toml", "fit d -o c.toml"),
    ("synth --rig r.toml -n 90 -o d", "paper synth --rig r.toml -n 90 -o d"),
    ("train --real r --sim s -o w", "paper train --real r --sim s -o w"),
    ("train --real r --sim=s --lambda 0.1 -o w", "paper train --real r --sim=s --lambda 0.1 -o w"),
    ("train --real r --lambda=0.1 -o w", "paper train --real r --lambda=0.1 -o w"),
    ("train --model network --real r -o w", "paper train --real r -o w"),
    ("train --model physics --real r --coefficients c -o w", "train --real r --coefficients c -o w"),
    ("train --real r --coefficients c -o w", "train --real r --coefficients c -o w"),
    ("train --real r --coefficients c --lambda 0.1 -o w", "train --real r --coefficients c --lambda 0.1 -o w"),
    ("predict-gate g.onnx d", "predict --gate g.onnx d"),
    ("predict-gate -o out.csv g.onnx d --quiet", "predict --gate g.onnx d --quiet -o out.csv"),
    ("predict-gate g.onnx d --out out.csv", "predict --gate g.onnx d -o out.csv"),
    ("predict-gate --help", "predict --help"),
    ("replay s --check", "session replay s --check"),
    ("convert s --to csv -o x.csv", "session convert s --to csv -o x.csv"),
    ("recover s", "session recover s"),
    ("vision calibrate a.jpg", "vision-calibrate a.jpg"),
    ("vision tune s", "vision-tune s"),
    ("vision a.jpg tune", "vision a.jpg tune"),
    ("discover --identifiability r.toml --level L1", "identifiability r.toml --level L1"),
    ("discover --level L1 --identifiability=r.toml", "identifiability r.toml --level L1"),
    ("discover d --json out.json", "discover d --json out.json"),
])
def test_old_spelling_becomes_the_new_one(old: str, new: str) -> None:
    assert " ".join(forward(old.split())) == new


@pytest.mark.parametrize(("words", "new"), [
    (["replay", "nowhere"], "session replay"), (["recover", "nowhere"], "session recover"),
    (["convert", "nowhere", "--to", "csv", "-o", "x"], "session convert"),
    (["fit", "nowhere", "--method", "grid"], "paper fit"), (["fit", "nowhere", "--method", "ml"], "fit"),
    (["synth", "--rig", "nowhere", "--coefficients", "nowhere", "-o", "x"], "paper synth"),
    (["train", "--real", "nowhere", "--sim", "nowhere", "-o", "x"], "paper train"),
    (["predict-gate", "nowhere", "nowhere"], "predict --gate GATE"),
    (["discover", "--identifiability", "nowhere"], "identifiability"),
])
def test_old_spelling_runs_and_prints_the_new_one(words, new, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    first, *rest = capsys.readouterr().err.splitlines()
    said, _, now = first.partition("` is an earlier spelling; now: ")
    assert said.startswith(f"truearc {words[0]}: warning: `{words[0]}") and now == f"truearc {new}"
    assert f"truearc {said.partition('`')[2]}" != now
    assert any("nowhere" in line for line in rest)


@pytest.mark.parametrize(("old", "new"), sorted(RENAMED.items()))
def test_other_old_names_are_refused_with_the_new_one(old: str, new: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([old, "--quiet"]) == 2
    assert capsys.readouterr().err == f"truearc {old}: was renamed; use: truearc {new}\n"
    assert new in NAMES


def test_old_names_are_not_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    listed = {line[2:20].strip() for line in capsys.readouterr().out.splitlines() if line.startswith("  ")}
    assert not listed & ({*FORWARDED, *RENAMED} - set(NAMES))
