"""Docstrings, comments, messages and pages avoid the phrases of phrases.toml."""

from pathlib import Path

import pytest

from tools.prose import (
    ROOT,
    Hit,
    find_files,
    find_hits,
    load_phrases,
    split_markdown,
    split_python,
)

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


def test_pieces_carry_their_lines() -> None:
    assert [(piece.kind, piece.line) for piece in split_python('"""A b."""\n\n# c d\nx = "e f"\n')] == [
        ("D", 1), ("M", 4), ("C", 3)]
    assert [piece.line for piece in split_markdown("a\n\n```\nb\n```\n\nc\n")] == [1, 7]
