"""Jobs over many processes, and their results kept as lines of a file.

Processes are this machine's by default, a Dask cluster's when its scheduler is named. A job must be a pure function of
its argument; then the results are the same whatever runs them, and a job lost with the process that ran it can simply
be run again. Lines of JSON are appended whole, so that a run that was cut short goes on where it stopped.
"""

import lzma
import multiprocessing
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
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

PATIENCE_S = 10.0                     # a scheduler, and a worker of its, must answer within this
ATTEMPTS = 3                          # a process may die this often at one place before the job itself is blamed


def fan_out(function: Callable[[Job], Result], jobs: Sequence[Job], scheduler: str | None = None,
            progress: Progress = lambda done, note: None, workers: int | None = None,
            keep: Keep = lambda job, result: None, patience_s: float = PATIENCE_S) -> list[Result]:
    """[function(job) for job in jobs], in that order, whatever runs them.

    function: one that pickle finds by its name (no closure), as are jobs and results; workers import the main module,
    so a script that calls this needs its `if __name__ == "__main__"`.

    keep: called here with each job and its result, once, as soon as it is there (and, but on a cluster, those before it
    are), so that whoever is killed has kept those.
    `scheduler`: address of a running Dask cluster, such as "tcp://host:8786", whose workers have truearc installed;
    it, and a worker of its, must answer within `patience_s`.
    Otherwise `workers` processes of this machine (default: one a core; 1 = this process). A worker that dies in the
    middle loses nothing: its jobs are run again. An exception of a job is raised here. InputError when the cluster does
    not answer, or when one job kills every process it is given.
    """
    jobs = list(jobs)
    if jobs:
        progress(0.0, f"0 of {len(jobs)} done")
    if scheduler is not None:
        return _on_cluster(function, jobs, scheduler, progress, keep, patience_s)
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
    done: dict[int, Result] = {}      # by place among the jobs; what a worker was at when it died is missing
    kept = deaths = 0
    while kept < len(jobs):
        first, futures = kept, dict[int, Future[Result]]()
        pool = ProcessPoolExecutor(min(workers, len(jobs) - kept), multiprocessing.get_context("spawn"))
        try:
            for place in range(kept, len(jobs)):
                if place not in done:
                    futures[place] = pool.submit(function, jobs[place])
            while kept < len(jobs):
                if kept not in done:
                    done[kept] = futures[kept].result()
                _kept(jobs[kept], done[kept], keep, kept + 1, len(jobs), progress)
                kept += 1
        except BrokenProcessPool as error:
            deaths = deaths + 1 if kept == first else 1
            if deaths >= ATTEMPTS:
                raise InputError(f"job {kept + 1} of {len(jobs)}, or one beside it, has killed {ATTEMPTS} processes "
                               "(out of memory?)") from error
            done |= {place: future.result() for place, future in futures.items() if _has_result(future)}
        finally:
            pool.shutdown(cancel_futures=True)
    return [done[place] for place in range(len(jobs))]


def _has_result(future: Future[Any]) -> bool:
    return future.done() and not future.cancelled() and future.exception() is None


def _on_cluster(function: Callable[[Job], Result], jobs: list[Job], scheduler: str, progress: Progress,
                keep: Keep, patience_s: float) -> list[Result]:
    try:
        from distributed import Client, as_completed  # an extra of its own: only who names a scheduler needs it
    except ModuleNotFoundError as error:
        raise InputError(f"--scheduler {scheduler}: needs {error.name}: "
                         "pip install './proof[cluster]' in a checkout") from error
    with _connect(Client, scheduler, patience_s) as client:
        futures = client.map(function, jobs, pure=False, retries=ATTEMPTS)
        place = {future.key: number for number, future in enumerate(futures)}
        results: dict[int, Result] = {}
        # each result is fetched as soon as it is there: one that only a dead worker held is worked out again
        for future, result in as_completed(futures, with_results=True):
            results[place[future.key]] = _kept(jobs[place[future.key]], result, keep, len(results) + 1, len(jobs),
                                               progress)
    return [results[number] for number in range(len(jobs))]


def _connect(client: Callable[..., Any], scheduler: str, patience_s: float) -> Any:
    """A client of a cluster that has at least one worker; InputError within seconds when there is none."""
    try:
        connected = client(scheduler, timeout=patience_s)
    except (OSError, TimeoutError, ValueError) as error:
        raise InputError(f"--scheduler {scheduler}: no scheduler answers ({error})") from error
    try:
        connected.wait_for_workers(1, timeout=patience_s)
    except TimeoutError as error:
        connected.close()
        raise InputError(f"--scheduler {scheduler}: the cluster has no workers") from error
    return connected


# --- lines of a file

Line = dict[str, Any]


def fill(path: Path, jobs: Mapping[str, Job], run: Callable[[Job], Line], progress: Progress,
         workers: int | None = None, scheduler: str | None = None) -> dict[str, Line]:
    """{key: line} of the whole file, once the jobs whose keys were not there have run.

    Each line is appended, with its key, as soon as its job is done: what is cut short goes on where it stopped.
    scheduler: of a Dask cluster, whose workers need not see the file.
    """
    mend(path)
    there = {line["key"] for line in lines_of(path)}
    todo = [(key, job) for key, job in jobs.items() if key not in there]
    if scheduler is None:
        fan_out(partial(_add, path.resolve(), run), todo, progress=progress, workers=workers)
    else:
        fan_out(partial(_run, run), todo, scheduler, progress, keep=lambda job, line: append_line(path, line))
    return {line["key"]: line for line in lines_of(path)}


def _add(path: Path, run: Callable[[Job], Line], job: tuple[str, Job]) -> None:
    append_line(path, _run(run, job))


def _run(run: Callable[[Job], Line], job: tuple[str, Job]) -> Line:
    return {"key": job[0], **run(job[1])}


def append_line(path: str | Path, line: Any) -> None:
    """In one write at the end of the file: lines of two processes never mix."""
    _append(path, msgspec.json.encode(line) + b"\n")


def mend(path: str | Path) -> None:
    """End a line that a kill has torn, so that the next one stands by itself."""
    path = Path(path)
    if path.is_file() and path.stat().st_size and not path.read_bytes().endswith(b"\n"):
        _append(path, b"\n")


def lines_of(path: Path) -> Iterator[dict[str, Any]]:
    """Whole lines of a file of worlds, packed (.xz) or not; the last may have been torn by a kill."""
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
