"""Links of the project's pages lead to files and headings, and every page that a file names exists."""

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *(page for folder in ("docs", "benchmarks", "examples", ".github")
                                      for page in (ROOT / folder).rglob("*.md"))])
NAMED_IN = (".py", ".toml", ".md", ".html", ".yml", ".yaml", ".cff", ".txt", ".in")
NAME = re.compile(r"(?<![\w./<{*-])(?:\.\.?/)*[\w-][\w./-]*\.md\b")
ELSEWHERE = ("parameters/SparkParameters-v0.1.2.md",)           # a page of REV's, quoted as the source of facts
MADE_BY_TESTS = ("bare.md", "page.md", "notes.md", "a.md", "docs/gone.md")      # files that tests write themselves


def anchors(page: Path) -> set[str]:
    """As they are made of headings where such pages are usually read, and those that a page sets itself."""
    text = page.read_text(encoding="utf-8")
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    made = {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}
    return made | set(re.findall(r'<a id="([^"]+)">', text))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(page: Path) -> None:
    links = re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8"))
    for link in (link for link in links if "://" not in link):
        path, _, anchor = link.partition("#")
        there = page.parent / path if path else page
        assert there.exists(), link
        assert not anchor or anchor in anchors(there), link


def tracked_texts() -> list[Path]:
    done = subprocess.run(["git", "ls-files", "--cached", "--others", "--exclude-standard"], cwd=ROOT,
                          capture_output=True, text=True, check=False)
    paths = [ROOT / name for name in done.stdout.splitlines()]
    return [path for path in paths if path.is_file() and (path.suffix in NAMED_IN or path.name == "Makefile")]


def names_without_a_page(path: Path, text: str) -> list[str]:
    """Names of Markdown files in a text that lead nowhere: from the root, from the file's folder, or from docs/."""
    test = ROOT / "tests" in path.parents           # tests join names to a folder that they have in a variable
    known = (*ELSEWHERE, *(MADE_BY_TESTS if test else ()))
    names = [name for name in NAME.findall(re.sub(r"\w+://\S+", "", text)) if name not in known]
    places = (ROOT, path.parent, *((ROOT / "docs", ROOT / "benchmarks" / "results") if test else ()))
    return [name for name in names if not any((place / name).is_file() for place in places)]


def test_named_pages_exist() -> None:
    texts = tracked_texts()
    if not texts:
        pytest.skip("not a git checkout")
    lost = {path.relative_to(ROOT).as_posix(): names_without_a_page(path, path.read_text(encoding="utf-8"))
            for path in texts}
    assert {name: names for name, names in lost.items() if names} == {}


def test_a_lost_page_is_found() -> None:
    text = "see docs/gone.md, ARCHITECTURE.md and https://host/other.md"
    assert names_without_a_page(ROOT / "sim" / "x.py", text) == ["docs/gone.md"]
