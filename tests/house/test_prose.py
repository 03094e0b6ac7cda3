"""Docstrings, comments, messages and pages avoid the phrases of phrases.toml; and grades of reading."""

import json
from pathlib import Path

import pytest

from tools.prose import (
    ROOT,
    Hit,
    find_files,
    find_hits,
    load_phrases,
    split_html,
    split_markdown,
    split_python,
    split_toml,
)
from tools.reading_grade import count_syllables, grade

PHRASES = load_phrases()
FILES = find_files()


def hits_of(tmp_path: Path, name: str, source: str) -> list[Hit]:
    path = tmp_path / name
    path.write_text(source, encoding="utf-8")
    return find_hits(path, PHRASES)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_file_has_none_of_the_phrases(path: Path) -> None:
    told = [f"line {hit.line}: {hit.found!r}; write: {hit.use}" for hit in find_hits(path, PHRASES)]
    assert not told, "\n".join(told)


@pytest.mark.parametrize(("source", "found"), [
    ('"""What is left over."""\n', {"What is", "left over"}),
    ("x = 1  # nobody\n# knows; but\n# for it\n", {"nobody", "but for"}),
    ('print(f"{n} a shot, it is told")\n', {"} a shot", "told"}),
    ('x = "luck"\nluck = {"doubt": 1}\n', set()),
    ('x = "by luck"  # prose: allow\n', set()),
    ('print("What is this")\n', set()),
])
def test_python_text_is_searched(tmp_path: Path, source: str, found: set[str]) -> None:
    assert {hit.found for hit in hits_of(tmp_path, "a.py", source)} == found


@pytest.mark.parametrize(("source", "found"), [
    ("by luck\n\n```sh\nluck\n```\n\n`doubt` is fine\n", {"luck"}),
    ("so\nmany\n", {"so many"}),
    ("| luck | <!-- prose: allow -->\n| anew |\n", {"anew"}),
])
def test_markdown_text_is_searched(tmp_path: Path, source: str, found: set[str]) -> None:
    assert {hit.found for hit in hits_of(tmp_path, "a.md", source)} == found


def test_notebooks_are_searched_and_so_is_the_paper(tmp_path: Path) -> None:
    cells = [{"cell_type": "markdown", "source": ["# A\n", "\n", "by luck\n"]},
             {"cell_type": "code", "source": ["x = 'anew'  # so many\n"], "outputs": ["luck"]}]
    hits = hits_of(tmp_path, "a.ipynb", json.dumps({"cells": cells}, indent=1))
    assert [(hit.line, hit.found) for hit in hits] == [(8, "luck"), (14, "so many")]
    assert {"paper.md", "what-is-missing.ipynb"} <= {path.name for path in FILES}


@pytest.mark.parametrize(("name", "source", "found"), [
    ("a.toml", '# so\n# many\nx = "by luck"\nluck = "doubt"\ny = "by luck"  # prose: allow\n', {"so many", "luck"}),
    ("a.txt", "By\nluck.\n\nSo\n\nmany.\n", {"luck"}),
    ("a.html", '<style>by luck</style><p class="by luck">so many</p>\n<script>\n// anew here\nsay(`by luck`)</script>',
     {"so many", "anew", "luck"}),
])
def test_text_of_other_files_is_searched(tmp_path: Path, name: str, source: str, found: set[str]) -> None:
    hits = hits_of(tmp_path, name, source)
    assert {hit.found for hit in hits} == found and len(hits) == len(found)


def test_pieces_carry_their_lines() -> None:
    assert [(piece.kind, piece.line) for piece in split_python('"""A b."""\n\n# c d\nx = "e f"\n')] == [
        ("D", 1), ("M", 4), ("C", 3)]
    assert [(piece.kind, piece.line) for piece in split_html("<p>a b</p>\n<script>\nx = 'c d'\n// e f\n</script>")] == [
        ("T", 1), ("M", 3), ("C", 4)]
    assert [(piece.kind, piece.line) for piece in split_toml('x = "a # b"\n\ny = "c"  # d e\n')] == [("M", 1), ("C", 3)]
    assert [piece.line for piece in split_markdown("a\n\n```\nb\n```\n\nc\n")] == [1, 7]


@pytest.mark.parametrize(("word", "count"), [
    ("ball", 1), ("the", 1), ("simulation", 4), ("table", 2), ("leave", 1), ("wheels", 1), ("uncertainty", 4)])
def test_syllables_are_counted(word: str, count: int) -> None:
    assert count_syllables(word) == count


def test_grade_of_a_text_worked_out_by_hand() -> None:
    """Two sentences, 9 words, 10 syllables; a decimal point ends no sentence."""
    assert grade(["The ball leaves the wheel 1.5 m high. It falls."]) == pytest.approx(
        (2, 4.5, 10.0 / 9.0, 0.39 * 4.5 + 11.8 * 10.0 / 9.0 - 15.59))
