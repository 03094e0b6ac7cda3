"""The site: MkDocs builds it without a warning, it needs no network, and it can be read in an afternoon."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tools import pages
from tools.pages import MARKS, PAGES, keep, load_printed, show
from tools.site_hooks import unlink_outside

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
GROUPS = ["Tutorials", "How-to", "Reference", "Explanation", "Measured"]


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


def test_pages_are_in_five_groups(site: Path) -> None:
    tabs = re.findall(r'<li class="md-tabs__item[^"]*">\s*<a [^>]*>\s*([^<]*?)\s*</a>',
                      (site / "index.html").read_text(encoding="utf-8"))
    assert tabs[1:] == GROUPS


def test_site_fetches_nothing_from_elsewhere(site: Path) -> None:
    fetched = re.compile(r'<(?:script|img|iframe)[^>]* src="(?:https?:)?//|<link[^>]* href="(?:https?:)?//')
    assert not [path.name for path in site.rglob("*.html") if fetched.search(path.read_text(encoding="utf-8"))]


def test_every_link_of_the_site_leads_to_a_file(site: Path) -> None:
    lost = [(path.name, link) for path in site.rglob("*.html") if path.name != "404.html"
            for link in re.findall(r'(?:href|src)="([^"#?:]+)[#"?]', path.read_text(encoding="utf-8"))
            if not (path.parent / link).exists()]
    assert lost == []


def test_lists_and_tables_are_rendered_as_such(site: Path) -> None:
    raw = re.compile(r"^\s*(?:[-*] |\d+\. |\||```)", re.MULTILINE)
    assert [(path.name, said) for path in site.rglob("*.html")
            for said in re.findall("<p>(.*?)</p>", path.read_text("utf-8"), re.DOTALL) if raw.search(said)] == []


def test_links_out_of_the_site_become_names() -> None:
    text = "[the tick](../../robot/tick.py#top), [aim](aim.md), [a](https://host/a.md), ![b](../images/demo.png)"
    told = "the tick (`robot/tick.py`), [aim](aim.md), [a](https://host/a.md), ![b](../images/demo.png)"
    assert unlink_outside(text, DOCS / "how-to") == told


@pytest.mark.parametrize("name", PAGES)
def test_pages_are_as_generated(name: str) -> None:
    stale = [path.name for path, text in PAGES[name]().items() if path.read_text(encoding="utf-8") != text]
    assert stale == [], f"run `python -m tools.pages {name}`"


MARKED = [page for page in sorted(DOCS.rglob("*.md")) if MARKS.search(page.read_text(encoding="utf-8"))]
DRAWN = re.compile(r"^<!-- (?:rounds: begin|result: ).*?-->$.*?^<!-- (?:rounds: )?end -->$", re.DOTALL | re.MULTILINE)


def test_no_table_of_measurements_is_typed() -> None:
    typed = {page.name: re.findall(r"^\|---.*|^```text$", DRAWN.sub("", page.read_text(encoding="utf-8")), re.MULTILINE)
             for page in (DOCS / "measured").glob("*.md")}
    assert {name: lines for name, lines in typed.items() if lines} == {}


def test_every_result_is_shown_once() -> None:
    shown = [found[2] for page in MARKED for found in MARKS.finditer(page.read_text(encoding="utf-8"))]
    assert sorted(shown) == sorted({*shown, *load_printed()})


def test_a_result_file_is_shown_with_its_command() -> None:
    kept = "python -m benchmarks.x --out FILE\ncommit 12345678, 2026-11-28\n\nfirst  1\nsecond 2\n"
    command = "\n`python -m benchmarks.x --out FILE`, commit 12345678, 2026-11-28:\n\n"
    assert show(kept) == f"{command}```text\nfirst  1\nsecond 2\n```\n"
    assert show(kept, "^sec") == f"{command}```text\nsecond 2\n```\n"
    kept = kept.replace("first  1\nsecond 2", "### x\n\n| a |\n|---|\n| 1 |")
    assert show(kept) == f"{command}### x\n\n| a |\n|---|\n| 1 |\n"


def test_a_run_is_kept_with_what_it_printed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pages, "PRINTED", tmp_path / "printed.txt")
    (tmp_path / "printed.txt").write_text("== zero\npython\ncommit\n\n0\n", encoding="utf-8")
    keep("count", "python -c 'print(6 * 7)'")
    assert load_printed()["zero"] == "python\ncommit\n\n0"
    command, made, *printed = load_printed()["count"].splitlines()
    assert command == "python -c 'print(6 * 7)'" and printed == ["", "42"]
    assert re.fullmatch(r"commit [0-9a-f]{8}( with changes)?, \d{4}-\d\d-\d\d", made)
