"""The site: MkDocs builds it without a warning, it needs no network, and figures come from result files."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tools.pages import PAGES

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built site; the build is strict: a page out of nav, a lost link or a lost anchor ends it."""
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run([sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)],
                          cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "WARNING -" not in done.stderr, done.stderr
    return folder


def test_every_page_is_built(site: Path) -> None:
    pages = {path.relative_to(DOCS).with_suffix(".html").as_posix().replace("README", "index")
             for path in DOCS.rglob("*.md")}
    assert pages == {path.relative_to(site).as_posix() for path in site.rglob("*.html")} - {"404.html"}


def test_site_fetches_nothing_from_elsewhere(site: Path) -> None:
    fetched = re.compile(r'<(?:script|img|iframe)[^>]* src="(?:https?:)?//|<link[^>]* href="(?:https?:)?//')
    assert not [path.name for path in site.rglob("*.html") if fetched.search(path.read_text(encoding="utf-8"))]


def test_every_link_of_the_site_leads_to_a_file(site: Path) -> None:
    lost = [(path.name, link) for path in site.rglob("*.html") if path.name != "404.html"
            for link in re.findall(r'(?:href|src)="([^"#?:]+)[#"?]', path.read_text(encoding="utf-8"))
            if not (path.parent / link).exists()]
    assert lost == []


@pytest.mark.parametrize("name", PAGES)
def test_pages_are_as_generated(name: str) -> None:
    stale = [path.name for path, text in PAGES[name]().items() if path.read_text(encoding="utf-8") != text]
    assert stale == [], f"run `python -m tools.pages {name}`"


DRAWN = re.compile(r"^<!-- (?:rounds: begin|result: ).*?-->$.*?^<!-- (?:rounds: )?end -->$", re.DOTALL | re.MULTILINE)


def test_no_table_of_measurements_is_typed() -> None:
    typed = {page.name: re.findall(r"^\|---.*|^```text$", DRAWN.sub("", page.read_text(encoding="utf-8")), re.MULTILINE)
             for page in (DOCS / "measured").glob("*.md")}
    assert {name: lines for name, lines in typed.items() if lines} == {}
