"""The Python example of README.md, on the spreadsheet that it names; and the same calls on a session with an effect."""

import re
import shutil
from pathlib import Path

import pytest

import truearc as ta

ROOT = Path(__file__).parents[2]
SPREADSHEET = "examples/spreadsheet"


def readme_example() -> str:
    return re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)[0]


def test_readme_example_has_ten_lines() -> None:
    assert len([line for line in readme_example().splitlines() if line]) == 10


@pytest.mark.slow
def test_readme_example_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                             capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copytree(ROOT / SPREADSHEET, tmp_path / SPREADSHEET)
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(compile(readme_example(), "README.md", "exec"), names)
    found = names["found"]
    assert isinstance(found, ta.Finding) and found.verdict == "set"
    assert "wheel_slip" in {effect.term for effect in found.effects}       # the world in which the shots were made
    assert "estimates" in capsys.readouterr().out
    assert (tmp_path / "finding.html").stat().st_size > 1000 and (tmp_path / "gate.onnx").stat().st_size > 1000


@pytest.mark.slow
def test_results_of_discovery_lead_to_design_and_gate(folder: Path, tmp_path: Path) -> None:
    week = ta.load_dataset(folder)
    found = ta.discover(week, seed=0)
    assert found.verdict in ("named", "set", "unknown")
    if found.best is not None:
        assert found.best.term and found.best.interval90[0] < found.best.interval90[1]
    assert isinstance(found.alternatives, tuple)
    found.to_html(tmp_path / "finding.html")
    assert found.to_json() and found.plot_residuals() and (tmp_path / "finding.html").stat().st_size > 1000
    plan = ta.design_shots(week, found, shots=100)
    assert plan.verdict == found.verdict
    assert len(ta.identifiability(week.rig, level="L1", shots=100).table()) > 20
    gate = ta.train_gate(week, found.adopt(), seed=0)
    assert gate.holdout is not None and 0.0 < gate.holdout.brier < 0.5
    gate.export(tmp_path / "gate.onnx")
    assert {one.name for one in ta.catalogue()} >= {"gravity", "drag", "magnus"}
