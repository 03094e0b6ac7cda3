"""Lines survive what a kill can do to a file."""

import io
import lzma
import tarfile
from pathlib import Path

import pytest

from truearc.errors import InputError
from truearc_proof import parallel as jsonl_store
from truearc_proof.parallel import append_line, fill, lines_of, mend
from truearc_proof.rounds import Room, archive


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


def test_what_unpacks_to_more_than_a_limit_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "worlds.jsonl.xz"
    monkeypatch.setattr(jsonl_store, "MAX_BYTES", 1_000_000)
    path.write_bytes(lzma.compress(b" " * 900_000 + b"{}\n"))
    assert list(lines_of(path)) == [{}]
    path.write_bytes(lzma.compress(bytes(1_100_000)))
    with pytest.raises(InputError, match=r"worlds\.jsonl\.xz: unpacks to more than 1000000 bytes"):
        list(lines_of(path))
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(InputError):
        list(lines_of(path))
    path.write_bytes(b"no xz")
    with pytest.raises(InputError, match=r"worlds\.jsonl\.xz: is damaged"):
        list(lines_of(path))


def test_a_round_that_unpacks_to_more_than_a_limit_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(archive, "MAX_BYTES", 1_000_000)
    with tarfile.open(tmp_path / "round.tar.xz", "w:xz") as tar:
        entry = tarfile.TarInfo("ledger.jsonl")
        entry.size = 1_100_000
        tar.addfile(entry, io.BytesIO(bytes(entry.size)))
    with pytest.raises(InputError, match=r"round\.tar\.xz: unpacks to more than 1000000 bytes"):
        archive.unpack(tmp_path / "round.tar.xz", Room(tmp_path / "round"))
    assert not (tmp_path / "round").exists()
