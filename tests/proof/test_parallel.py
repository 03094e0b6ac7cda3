"""Jobs over processes, and lines that survive what a kill can do to a file."""

import io
import lzma
import os
import tarfile
from pathlib import Path

import numpy as np
import pytest

from truearc.errors import InputError
from truearc_proof import parallel as jsonl_store
from truearc_proof.parallel import append_line, fan_out, fill, lines_of, mend
from truearc_proof.rounds import Room, archive

JOBS = list(range(12))


def draw(seed):
    """A pure function of its job."""
    return np.random.default_rng(seed).normal(size=3)


def fail_late(job):
    if job == JOBS[-1]:
        raise ValueError(f"job {job} is wrong")
    return job


def die(seed):
    os._exit(1)


EXPECTED = [np.random.default_rng(seed).normal(size=3) for seed in JOBS]


def same(results):
    return len(results) == len(EXPECTED) and all(np.array_equal(*pair) for pair in zip(results, EXPECTED, strict=True))


def test_results_come_in_the_order_of_the_jobs_and_progress_ends_at_one():
    shown, kept = [], []
    assert same(fan_out(draw, JOBS, workers=1, progress=lambda done, note: shown.append(done),
                        keep=lambda job, result: kept.append((job, result))))
    assert fan_out(draw, []) == [] and [job for job, _ in kept] == JOBS and same([result for _, result in kept])
    assert len(shown) == len(JOBS) + 1 and shown[0] == 0.0 and shown[-1] == 1.0 and shown == sorted(shown)


def test_results_of_several_processes_are_the_same_and_one_that_dies_is_told() -> None:
    assert same(fan_out(draw, JOBS, workers=2))
    with pytest.raises(InputError, match="job 1 of 2, or one beside it, has killed its process"):
        fan_out(die, [1, 2], workers=2)


def test_an_exception_of_a_job_is_raised_as_it_is_and_what_is_there_is_kept():
    kept = []
    with pytest.raises(ValueError, match="job 11 is wrong"):
        fan_out(fail_late, JOBS, workers=1, keep=lambda job, result: kept.append(job))
    assert kept == JOBS[:-1]
    with pytest.raises(ValueError, match="job 11 is wrong"):
        fan_out(fail_late, JOBS, workers=2)


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
    path.write_bytes(lzma.compress(b'{"key": 1}\n'))
    assert list(lines_of(path)) == [{"key": 1}]
    monkeypatch.setattr(jsonl_store, "MAX_BYTES", 1_000_000)
    path.write_bytes(lzma.compress(b" " * 900_000 + b"{}\n"))
    assert list(lines_of(path)) == [{}]
    path.write_bytes(lzma.compress(bytes(1_100_000)))
    with pytest.raises(InputError, match=r"worlds\.jsonl\.xz: unpacks to more than 1000000 bytes"):
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
