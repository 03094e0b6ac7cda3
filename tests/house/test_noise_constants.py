"""Numbers of the noise model are written in one file."""

import ast
import re
from pathlib import Path

SIM = Path(__file__).parents[2] / "sim"
NOISE = SIM / "infer" / "likelihood" / "noise.py"
NOISY = re.compile(r"LAPSE|SLIP_|SCATTER_(PRIOR|MOST)|OUTLIER")


def literals(path: Path) -> set[str]:
    """Names of a module's constants that are written as numbers, or tables of them."""
    found = set()
    for line in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(line, ast.Assign) and isinstance(line.targets[0], ast.Name):
            parts = [part for part in ast.walk(line.value) if isinstance(part, ast.Constant)]
            names = [part for part in ast.walk(line.value) if isinstance(part, ast.Name | ast.Call)]
            if parts and not names and any(isinstance(part.value, int | float) for part in parts):
                found.add(line.targets[0].id)
    return found


def test_lapses_slips_and_scatters_are_numbers_of_one_file() -> None:
    assert len([name for name in literals(NOISE) if NOISY.search(name)]) >= 5
    elsewhere = {str(path.relative_to(SIM)): names for path in sorted(SIM.rglob("*.py")) if path != NOISE
                 if (names := {name for name in literals(path) if NOISY.search(name)})}
    assert not elsewhere
