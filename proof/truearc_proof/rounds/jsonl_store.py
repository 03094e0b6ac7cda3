"""Files of worlds: a line of JSON each, appended whole, so that a run that was cut short goes on where it stopped."""

import lzma
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from truearc.errors import MAX_BYTES, NO_JSON, InputError, about
from truearc.sim.printed import Progress
from truearc_proof.parallel import fan_out

Job = TypeVar("Job")
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
