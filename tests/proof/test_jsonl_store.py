"""Lines survive what a kill can do to a file."""

import lzma
from pathlib import Path

import pytest

from truearc_proof.rounds.jsonl_store import append_line, fill, lines_of, mend


def test_a_torn_line_costs_itself_alone(tmp_path: Path, capsys) -> None:
    path = tmp_path / "worlds.jsonl"
    assert list(lines_of(path)) == []
    mend(path)
    assert not path.exists()
    append_line(path, {"key": 1})
    with path.open("a") as file:
        file.write('{"key": 2, "jo')
    mend(path)
    append_line(path, {"key": 3})
    assert list(lines_of(path)) == [{"key": 1}, {"key": 3}]
    assert "a torn line" in capsys.readouterr().err


def test_packed_files_are_read(tmp_path: Path) -> None:
    path = tmp_path / "worlds.jsonl.xz"
    path.write_bytes(lzma.compress(b'{"key": 1}\n'))
    assert list(lines_of(path)) == [{"key": 1}]


def test_a_run_that_was_cut_short_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "worlds.jsonl"
    seen: list[int] = []

    def run(job: int) -> dict[str, int]:
        if job == 2:
            raise KeyboardInterrupt
        seen.append(job)
        return {"twice": 2 * job}

    with pytest.raises(KeyboardInterrupt):
        fill(path, {"a": 1, "b": 2, "c": 3}, run, lambda done, note: None, workers=1)
    lines = fill(path, {"a": 1, "c": 3}, run, lambda done, note: None, workers=1)
    assert seen == [1, 3]
    assert lines == {"a": {"key": "a", "twice": 2}, "c": {"key": "c", "twice": 6}}
