"""The software paper cites what its bibliography has, and the version is the same everywhere."""

import re
import tomllib
from datetime import date
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAPER = (ROOT / "paper" / "paper.md").read_text(encoding="utf-8")
BOOK = (ROOT / "paper" / "paper.bib").read_text(encoding="utf-8")
ENTRY = re.compile(r"^@(\w+)\{(\w+),\n(.*?)^\}", re.MULTILINE | re.DOTALL)


def test_paper_cites_all_of_its_bibliography_and_no_more() -> None:
    keys = [key for _, key, _ in ENTRY.findall(BOOK)]
    assert len(keys) == len(set(keys)) == BOOK.count("\n@") + 1
    assert set(re.findall(r"@(\w+)", PAPER.split("---", 2)[2])) == set(keys)


def test_version_is_the_same_everywhere() -> None:
    stated = {name: tomllib.loads((ROOT / name / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
              for name in (".", "proof", "frc")}
    version = stated["."]
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    released = re.search(r"^date-released: (\S+)$", citation, re.MULTILINE)
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert released is not None and date.fromisoformat(released[1]) and f"## {version} - {released[1]}" in changes
    assert stated["frc"] == stated["proof"] == version and f"\nversion: {version}\n" in citation
    assert f"Version {version}." in (ROOT / "README.md").read_text(encoding="utf-8")
