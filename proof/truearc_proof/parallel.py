"""Parallel jobs in processes on this machine, with their results kept as the lines of a file.

The lines are JSON and are appended whole, so that an interrupted run continues where it stopped.
"""

import lzma
import multiprocessing
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from truearc.errors import MAX_BYTES, NO_JSON, InputError, about
from truearc.sim.printed import Progress

Job = TypeVar("Job")
Result = TypeVar("Result")
Keep = Callable[[Any, Any], None]     # of a job and its result


def fan_out(function: Callable[[Job], Result], jobs: Sequence[Job],
            progress: Progress = lambda done, note: None, workers: int | None = None,
            keep: Keep = lambda job, result: None) -> list[Result]:
    """Return [function(job) for job in jobs], in that order, whichever process runs them.

    function: one that pickle finds by name (no closure), as are jobs and results; workers import the main module, so a
    script that calls this needs its `if __name__ == "__main__"`.

    keep: called here once for each job and its result, as soon as it and those before it are done, so that an
    interrupted run has kept those. workers: processes (default: one per core; 1 = this one). A job's exception is
    raised here. InputError if a process dies.
    """
    jobs = list(jobs)
    if jobs:
        progress(0.0, f"0 of {len(jobs)} done")
    count = min(workers or os.cpu_count() or 1, len(jobs))
    if count <= 1:
        return [_kept(job, function(job), keep, number, len(jobs), progress) for number, job in enumerate(jobs, 1)]
    return _on_processes(function, jobs, count, progress, keep)


def _kept(job: Job, result: Result, keep: Keep, number: int, total: int, progress: Progress) -> Result:
    keep(job, result)
    progress(number / total, f"{number} of {total} done")
    return result


def _on_processes(function: Callable[[Job], Result], jobs: list[Job], workers: int, progress: Progress,
                  keep: Keep) -> list[Result]:
    done: list[Result] = []
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"))
    try:
        for job, result in zip(jobs, pool.map(function, jobs), strict=True):
            done.append(_kept(job, result, keep, len(done) + 1, len(jobs), progress))
    except BrokenProcessPool as error:
        raise InputError(f"job {len(done) + 1} of {len(jobs)}, or one beside it, has killed its process (out of "
                         "memory?)") from error
    finally:
        pool.shutdown(cancel_futures=True)
    return done


# --- lines of a file

Line = dict[str, Any]


def fill(path: Path, jobs: Mapping[str, Job], run: Callable[[Job], Line], progress: Progress,
         workers: int | None = None) -> dict[str, Line]:
    """Return {key: line} of the whole file, after running the jobs whose keys were missing.

    Each line is appended, with its key, as soon as its job is done, so that an interrupted run resumes where it
    stopped.
    """
    mend(path)
    there = {line["key"] for line in lines_of(path)}
    todo = [(key, job) for key, job in jobs.items() if key not in there]
    fan_out(partial(_add, path.resolve(), run), todo, progress, workers)
    return {line["key"]: line for line in lines_of(path)}


def _add(path: Path, run: Callable[[Job], Line], job: tuple[str, Job]) -> None:
    append_line(path, {"key": job[0], **run(job[1])})


def append_line(path: str | Path, line: Any) -> None:
    """Append in one write: lines of two processes never mix."""
    _append(path, msgspec.json.encode(line) + b"\n")


def mend(path: str | Path) -> None:
    """End a truncated line, so that the next one stands by itself."""
    path = Path(path)
    if path.is_file() and path.stat().st_size and not path.read_bytes().endswith(b"\n"):
        _append(path, b"\n")


def lines_of(path: Path) -> Iterator[dict[str, Any]]:
    """Return whole lines of a file of worlds, packed (.xz) or not; a truncated last line is ignored."""
    data = path.read_bytes() if path.is_file() else b""
    for line in (_unpack(data, path) if path.suffix == ".xz" else data).splitlines():
        try:
            yield msgspec.json.decode(line)
        except NO_JSON:
            print(f"{path}: a torn line is left out", file=sys.stderr)


def _unpack(data: bytes, path: Path) -> bytes:
    unpacker = lzma.LZMADecompressor()
    with about(f"{path}: is damaged, or no .xz", lzma.LZMAError):
        unpacked = unpacker.decompress(data, MAX_BYTES + 1)
    if len(unpacked) > MAX_BYTES:
        raise InputError(f"{path}: unpacks to more than {MAX_BYTES} bytes, the most that is read of such a file")
    if not unpacker.eof:
        raise InputError(f"{path}: is cut short")
    return unpacked


def _append(path: str | Path, data: bytes) -> None:
    file = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
    try:
        os.write(file, data)
    finally:
        os.close(file)
