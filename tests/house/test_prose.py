"""Docstrings, comments, messages and pages avoid the phrases of phrases.toml; phrases_todo.txt has what is left."""

from pathlib import Path

import pytest

from tools.prose import (
    ROOT,
    Hit,
    find_files,
    find_hits,
    load_phrases,
    load_todo,
    make_todo,
    split_markdown,
    split_python,
)

PHRASES = load_phrases()
LEFT = load_todo()
FILES = find_files()


def hits_of(tmp_path: Path, name: str, source: str) -> list[Hit]:
    path = tmp_path / name
    path.write_text(source, encoding="utf-8")
    return find_hits(path, PHRASES)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_file_has_no_more_phrases_than_listed(path: Path) -> None:
    name, hits = path.relative_to(ROOT).as_posix(), find_hits(path, PHRASES)
    listed = LEFT.get(name, 0)
    told = "\n".join(f"{name}:{hit.line}: {hit.found!r}; write: {hit.use}" for hit in hits)
    assert len(hits) <= listed, f"{len(hits)} phrases to avoid, {listed} allowed by phrases_todo.txt:\n{told}"
    assert len(hits) == listed, f"phrases_todo.txt: lower {name} from {listed} to {len(hits)} (0: delete the line)"


def test_todo_lists_only_files_that_exist() -> None:
    assert set(LEFT) <= {path.relative_to(ROOT).as_posix() for path in FILES}
    assert all(count > 0 for count in LEFT.values())


def test_todo_is_read_as_it_is_written(tmp_path: Path) -> None:
    (tmp_path / "todo.txt").write_text(make_todo({"b.py": 2, "a.py": 0}), encoding="utf-8")
    assert load_todo(tmp_path / "todo.txt") == {"b.py": 2}


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
