"""The ten lines of Python that the documentation begins with, on a small session."""

from pathlib import Path

import pytest

import truearc as ta


@pytest.mark.slow
def test_the_ten_lines_run(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    week = ta.load_dataset(folder)
    fit = ta.fit(week, terms=["gravity", "drag", "magnus"])
    print(fit)
    found = ta.discover(week, belief=fit.belief, seed=0)
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
    assert "estimates" in capsys.readouterr().out
    assert {one.name for one in ta.catalogue()} >= {"gravity", "drag", "magnus"}
