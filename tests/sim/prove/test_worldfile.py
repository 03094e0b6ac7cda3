"""Lines survive what a kill can do to a file."""

import lzma
from pathlib import Path

from sim.prove.worldfile import append_line, lines_of, mend


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
