"""Records the sessions of `truearc reproduce` that are not there yet, side by side."""

import json
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from truearc.errors import InputError
from truearc.robot.config.schema import is_hash_of
from truearc.robot.recording.session import CAN, FRAMES, load_header
from truearc.sim.printed import Progress
from truearc.sim.world.emulated_robot import emulate
from truearc_proof.parallel import fan_out
from truearc_proof.reproduce.collect import Record, Recording

DONE = "recording.json"               # written last: a folder without it is incomplete and is recorded again


class _Job(NamedTuple):
    folder: Path
    recording: Recording


def make_record(folder: Path, scheduler: str | None, workers: int | None,
                make_progress: Callable[[str], Progress]) -> Record:
    """Return a function that records sessions in `folder`, unless they are there already, and returns their folders.

    The folders are in the order of the sessions. The function raises InputError when a session was recorded with other
    settings, or when a cluster's workers write to another disk.
    """
    def record(recordings: Sequence[Recording], what: str) -> list[Path]:
        # a worker elsewhere has another working directory
        jobs = [_Job(folder.resolve() / recording.name, recording) for recording in recordings]
        missing = [job for job in jobs if not _is_there(job)]
        if missing:
            folder.mkdir(parents=True, exist_ok=True)
            fan_out(_record, missing, scheduler, make_progress(f"record {what}"), workers)
        for job in missing:
            if not _is_there(job):
                raise InputError(f"{job.folder}: not here after it was recorded: the cluster's workers need this "
                                 f"folder")
        return [job.folder for job in jobs]

    return record


def _is_there(job: _Job) -> bool:
    path = job.folder / DONE
    if not path.is_file():
        return False
    said = json.loads(path.read_text(encoding="utf-8"))
    if said != _said(job.recording) or not is_hash_of(load_header(job.folder).config_sha256, job.recording.config):
        raise InputError(f"{job.folder}: recorded with other settings; name another folder or take this one away")
    return True


def _said(recording: Recording) -> dict[str, int]:
    return {"seed": recording.seed, "trials": recording.trials}


def _record(job: _Job) -> str:
    """Images and raw frames, nine tenths of a session, are not kept: every tick and mark is."""
    shutil.rmtree(job.folder, ignore_errors=True)
    emulate(job.recording.config, job.folder, job.recording.trials, job.recording.seed)
    shutil.rmtree(job.folder / FRAMES)
    (job.folder / CAN).unlink()
    (job.folder / DONE).write_text(json.dumps(_said(job.recording)) + "\n", encoding="utf-8")
    return str(job.folder)
