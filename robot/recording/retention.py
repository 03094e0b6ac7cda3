"""Retention of earlier sessions within the limits of [recording]: the oldest lose telemetry and images first.

`session.json`, `config.json`, `trials.jsonl`, models and aim files always stay, as do files that are not part of a
recording. Sessions are the folders beside the running one that have a session.json,
or a damaged one and telemetry; links are not followed.
"""

import os
import shutil
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from truearc.errors import InputError
from truearc.robot.config.schema import RecordingConfig
from truearc.robot.recording import session as layout
from truearc.robot.recording.files import lock_trouble

BULK = (layout.TELEMETRY, layout.CAN, layout.FRAMES, layout.LATENESS, layout.DAMAGED)
BYTES_PER_GB, S_PER_DAY = 1_000_000_000, 86_400.0
LOOK_S = 600.0                        # between looks: a session grows by some 70 MB meanwhile


class _Session(NamedTuple):
    """An earlier session."""

    ended_s: float                    # when its telemetry was written last, Unix
    folder: Path
    bulk_bytes: int                   # of what may go
    rest_bytes: int


def prune(running: Path, limits: RecordingConfig, now_s: float) -> list[Path]:
    """Delete the bulk of earlier sessions beyond the limits, oldest first; returns those that gave theirs up.

    A session that another process is recording counts, but keeps everything. What cannot be deleted stays, too.
    """
    total = sum(_bytes(running, name) for name in _names(running))
    sessions = sorted(filter(None, map(_look, _folders(running))))
    total += sum(one.bulk_bytes + one.rest_bytes for one in sessions)
    pruned = []
    for one in sessions:
        is_old = limits.keep_days is not None and now_s - one.ended_s > limits.keep_days * S_PER_DAY
        is_much = limits.keep_gb is not None and total > limits.keep_gb * BYTES_PER_GB
        if one.bulk_bytes and (is_old or is_much) and isinstance(       # unless another process may be writing it
                lock_trouble(one.folder / layout.TELEMETRY), FileNotFoundError | None):
            _delete_bulk(one.folder)
            total -= one.bulk_bytes - sum(_bytes(one.folder, name) for name in BULK)
            pruned.append(one.folder)
    return pruned


def start_pruning(limits: RecordingConfig | None, unix_s: Callable[[], float], running: Path) -> None:
    """Prune now and every ten minutes, in a thread of this process, as long as that lives; nothing without limits.

    `unix_s`: the time of day.
    """
    if limits is not None and limits != RecordingConfig():
        threading.Thread(target=_keep_pruning, args=(limits, unix_s, running), name="retention", daemon=True).start()


def _keep_pruning(limits: RecordingConfig, unix_s: Callable[[], float], running: Path) -> None:
    pause = threading.Event()
    while True:
        try:
            if pruned := prune(running, limits, unix_s()):
                print(f"truearc run: [recording]: telemetry and images of {len(pruned)} earlier sessions deleted, up "
                      f"to {pruned[-1].name}", file=sys.stderr, flush=True)
        except OSError as error:      # recording goes on; the next look may succeed
            print(f"truearc run: [recording]: earlier sessions were not deleted: {error}", file=sys.stderr, flush=True)
        pause.wait(LOOK_S)


def _folders(running: Path) -> list[Path]:
    try:
        with os.scandir(running.parent) as entries:
            return [Path(entry.path) for entry in entries
                    if entry.name != running.name and entry.is_dir(follow_symlinks=False)]
    except FileNotFoundError:
        return []


def _look(folder: Path) -> _Session | None:
    """The session in a folder; None when the folder holds none."""
    telemetry = folder / layout.TELEMETRY
    try:
        layout.load_header(folder)
    except InputError:                # of another program, or damaged as when the power fails
        if not ((folder / layout.HEADER).is_file() and telemetry.is_file()):
            return None
    try:
        ended_s = (telemetry if telemetry.exists() else folder / layout.HEADER).stat().st_mtime
    except OSError:
        return None
    bulk = sum(_bytes(folder, name) for name in BULK)
    return _Session(ended_s, folder, bulk, sum(_bytes(folder, name) for name in _names(folder)) - bulk)


def _names(folder: Path) -> list[str]:
    return os.listdir(folder) if folder.is_dir() else []


def _bytes(folder: Path, name: str) -> int:
    """Of a file, or of all in a folder; 0 when it is not there or has gone meanwhile."""
    total = 0
    for at, _, files in [(str(folder), (), (name,)), *os.walk(folder / name)]:
        for file in files:
            try:
                stat = os.lstat(os.path.join(at, file))
            except FileNotFoundError:
                continue
            total += stat.st_size
    return total


def _delete_bulk(folder: Path) -> None:
    for name in BULK:
        path = folder / name
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        elif path.exists() or path.is_symlink():
            path.unlink()
