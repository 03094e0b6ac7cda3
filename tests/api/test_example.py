"""The Python example of README.md, on the spreadsheet that it names; test_results.py has a session with an effect."""

import re
import shutil
from pathlib import Path

import pytest

import truearc as ta

ROOT = Path(__file__).parents[2]
SPREADSHEET = "examples/spreadsheet"


def readme_example() -> str:
    return re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)[0]


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
    page = (ROOT / "docs" / "tutorials" / "spreadsheet.md").read_text(encoding="utf-8")
    (first, second), low90, high90 = found.effects[:2], *found.best.interval90
    assert f"wheel slip ({first.probability:.0%}) or".replace("%", " %") in page and first.term == "wheel_slip"
    assert f"sinking air ({second.probability:.0%})".replace("%", " %") in page and second.term == "wind_z"
    assert f"(90 %: {100 * low90:.2f} to {100 * high90:.2f} %)" in page
    assert "estimates" in capsys.readouterr().out
    head = (tmp_path / "finding.html").read_text(encoding="utf-8")
    assert "made in Python" in head and re.search(r"20\d\d-\d\d-\d\d", head)
    assert (tmp_path / "finding.html").stat().st_size > 1000 and (tmp_path / "gate.onnx").stat().st_size > 1000
