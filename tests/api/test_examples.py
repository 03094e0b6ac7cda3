"""The Python example of README.md and the notebooks run as they are, and say what is printed of them."""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import nbformat
import pytest

import truearc as ta
from tools.notebooks import HOME, execute

ROOT = Path(__file__).parents[2]
SPREADSHEET = "examples/spreadsheet"


@pytest.mark.slow
def test_readme_example_runs(tmp_path, monkeypatch, capsys):
    shutil.copytree(ROOT / SPREADSHEET, tmp_path / SPREADSHEET)
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    exec(compile(re.findall(r"```python\n(.*?)```", text, re.DOTALL)[0], "README.md", "exec"), names)
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


# --- notebooks

ASK = "print(finding.to_json()); import json; print(json.dumps(fit.table().to_dict()))"
DIGITS = re.compile(r"[\d.]+")


def printed(cell: Any) -> str:
    return "".join(one["text"] for one in cell.outputs if one.output_type == "stream" and one.name == "stdout")


@pytest.fixture
def run_book(data_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A function that runs a notebook, which prints what is committed, digits aside. It returns the finding as JSON,
    the fit's values by name, and all that was printed."""
    monkeypatch.setenv("TRUEARC_DATA", str(data_dir))

    def run_book(name: str) -> tuple[dict[str, Any], dict[str, float], str]:
        book = nbformat.read(HOME / f"{name}.ipynb", as_version=4)
        before = [DIGITS.sub("#", printed(cell)) for cell in book.cells if cell.cell_type == "code"]
        book.cells.append(nbformat.v4.new_code_cell(ASK))
        execute(book, tmp_path)
        said = [printed(cell) for cell in book.cells if cell.cell_type == "code"]
        record, _, fitted = said.pop().strip().rpartition("\n")
        assert [DIGITS.sub("#", text) for text in said] == before, "run `python -m tools.notebooks`, and read them"
        table = json.loads(fitted)
        return json.loads(record), dict(zip(table["parameter"], table["value"], strict=True)), "".join(said)

    return run_book


@pytest.mark.slow
@pytest.mark.data
def test_throws_leave_drag_or_cameras_as_least_squares_says(run_book: Any) -> None:
    """Plain least squares of the same flights: drag 0.6 to 0.96 by what is free."""
    finding, fitted, _ = run_book("what-is-missing")
    assert finding["verdict"] == "set" and finding["mismatch"]["p_value"] <= 0.001
    assert [one["term"] for one in finding["what"][:2]] == ["drag", "track_perspective"]
    assert 0.7 < fitted["drag.cd"] < 1.1


@pytest.mark.slow
@pytest.mark.data
def test_backspin_lift_is_named_and_flights_end_where_it_says(run_book: Any) -> None:
    finding, fitted, said = run_book("lift-from-a-launcher")
    assert (finding["verdict"], finding["what"][0]["term"], finding["data"]["level"]) == ("named", "magnus", "L2")
    where, fit = finding["where"], finding["fit"]
    assert (where["stage"], where["direction"], where["covariate"]) == ("flight", "vertical", "exit_spin_rev_s")
    # three sessions, one spin each: an honest answer says that they cannot be told apart
    assert {"session", "wheel_bottom_rad_s"} <= set(where["inseparable"])
    # lift by plain parabolas: what spin adds upward, across flights that leave at about 5 m/s
    bent = {name: float(value) for name, value in re.findall(r"^(\w+) +bends by ([\d.]+)", said, re.MULTILINE)}
    assert len(bent) == 3 and bent["backspin"] < min(bent["no_spin"], bent["no_spin_robot"]) - 1.0
    (interval,) = finding["what"][0]["parameters"].values()
    assert interval["low90"] > 0.0
    # thirds of the launches say 0.042 to 0.045, a smooth ball's drag is 0.41 (docs/measured/real-data.md)
    assert 0.038 < fitted["magnus.cl"] < 0.050 and 0.38 < fitted["drag.cd"] < 0.48
    assert fit["gain_per_shot"] > 2.0 * fit["gain_se"]
    assert fit["height_rmse_after_m"] < 0.5 * fit["height_rmse_before_m"]
