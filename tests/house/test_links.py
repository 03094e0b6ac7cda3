"""Links, paths and commands of the project's pages: each leads to a file, a heading or a command that exists."""

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

from truearc.cli.main import COMMANDS, ENTRY_POINTS

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *(page for folder in ("docs", "benchmarks", "examples", ".github")
                                      for page in (ROOT / folder).rglob("*.md"))])

TOPS = ("hw", "robot", "sim", "model_export", "truearc", "proof", "frc", "benchmarks", "tests", "tools", "docs",
        "examples")
CODE_PATH = re.compile(rf"(?<![\w./<{{*-])(?:{'|'.join(TOPS)})/[\w./*<>{{}}-]*")
HISTORY = ("CHANGELOG.md", "docs/measured/proof.md")           # they name files and commands as they were
COMMAND = re.compile(r"(?<!import )(?<![\w./-])(?:\.venv/bin/)?truearc ([a-z][^`|;&#\n]*)")


def anchors(page: Path) -> set[str]:
    """As they are made of headings where such pages are usually read, and those that a page sets itself."""
    text = page.read_text(encoding="utf-8")
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    made = {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}
    return made | set(re.findall(r'<a id="([^"]+)">', text))


def test_links_lead_somewhere() -> None:
    lost = []
    for page in PAGES:
        for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
            path, _, anchor = link.partition("#")
            there = page.parent / path if path else page
            if "://" not in link and not (there.exists() and (not anchor or anchor in anchors(there))):
                lost.append((page.relative_to(ROOT).as_posix(), link))
    assert lost == []


def code_of(page: Path) -> str:
    """Fenced blocks and code spans of a page, a line each."""
    text = page.read_text(encoding="utf-8")
    blocks = re.findall(r"^ *```[^\n]*\n(.*?)^ *```", text, re.DOTALL | re.MULTILINE)
    spans = re.findall(r"`([^`\n]+)`", re.sub(r"^ *```.*?^ *```", "", text, flags=re.DOTALL | re.MULTILINE))
    return "\n".join([*blocks, *spans])


def lost_paths(code: str) -> list[str]:
    """Python files, TOML files and folders that code names from the root and that do not exist."""
    names = [name.rstrip(".-") for name in CODE_PATH.findall(code) if not set("*<>{}") & set(name)]
    return [name for name in names if Path(name).suffix in ("", ".py", ".toml") and not (ROOT / name).exists()]


def commands() -> set[str]:
    """Names of truearc's commands, of proof's and of frc's."""
    projects = [tomllib.loads((ROOT / name / "pyproject.toml").read_text(encoding="utf-8"))["project"]
                for name in ("proof", "frc")]
    return {command.name for command in COMMANDS}.union(*(one["entry-points"][ENTRY_POINTS] for one in projects))


def wrong_commands(code: str, known: set[str]) -> list[str]:
    """Commands that code calls and that do not exist."""
    called = [line.split() for line in COMMAND.findall(code)]
    return [" ".join(words) for words in called
            if not {words[0], " ".join(words[:2])} & known]


def current_pages() -> Iterator[Path]:
    yield from (page for page in PAGES if page.relative_to(ROOT).as_posix() not in HISTORY)


def test_paths_in_pages_exist() -> None:
    lost = {page.relative_to(ROOT).as_posix(): lost_paths(code_of(page)) for page in current_pages()}
    assert {name: names for name, names in lost.items() if names} == {}


def test_commands_in_pages_exist() -> None:
    known = commands()
    wrong = {page.relative_to(ROOT).as_posix(): wrong_commands(code_of(page), known) for page in current_pages()}
    assert {name: names for name, names in wrong.items() if names} == {}
