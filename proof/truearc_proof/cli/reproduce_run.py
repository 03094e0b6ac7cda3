"""The work of `truearc reproduce`: records, fits, trains, and writes tables and page."""

import argparse
import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from truearc.cli.common import SHIPPED, make_progress, origin_of
from truearc.errors import InputError
from truearc.robot.config.schema import is_hash_of, load_config
from truearc.robot.recording.session import CAN, FRAMES, load_header
from truearc.sim.data.files import save_dataset
from truearc.sim.printed import Progress
from truearc.sim.world.emulated_robot import emulate
from truearc_proof.parallel import fan_out
from truearc_proof.reproduce.analysis import analyse
from truearc_proof.reproduce.collect import Record, Recording, collect
from truearc_proof.reproduce.models import run_repetition, tasks_of, train_networks
from truearc_proof.reproduce.page import (
    OURS_NOT_THEIRS,
    headline,
    in_short,
    make_tables,
    save_figures,
    save_page,
    what_varies,
)
from truearc_proof.reproduce.settings import QUICK_DRAWS, Settings, quick

DONE = "recording.json"               # written last: a folder without it is incomplete and is recorded again
MARK = ".truearc-reproduce"           # a folder with this in it was made by us and may be gone on with


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


def reproduce(args: argparse.Namespace) -> int:
    """Make every table and figure; args: those of `truearc reproduce`."""
    settings = _settings(args)
    folder = _own_folder(args.out)

    def progress(what: str) -> Progress:
        return make_progress(what, args.quiet)

    if not args.quiet:
        print(OURS_NOT_THEIRS, flush=True)
    record = make_record(args.recordings or folder / "recordings", args.scheduler, args.workers, progress)
    pool = collect(load_config(SHIPPED), settings, record, progress("fit what to launch"))
    shutil.rmtree(folder / "data", ignore_errors=True)    # it follows from the recordings
    for name, part in (("real", pool.real), ("launched", pool.launched)):
        save_dataset(folder / "data" / name, part)
    repetitions = fan_out(run_repetition, tasks_of(pool, settings), args.scheduler, progress("fit and predict"),
                          args.workers)
    answers = train_networks(repetitions, settings, progress("train networks"))
    analysis = analyse(repetitions, answers, settings)
    tables = make_tables(repetitions, analysis, settings)
    save_figures(folder, pool, repetitions, analysis, tables, settings)
    save_page(folder / "index.html", pool, repetitions, answers, analysis, tables, settings,
              origin_of(args))
    for line in [*(table.text() for table in in_short(tables)), "", *what_varies(pool, settings), *headline(analysis)]:
        print(line)
    print(f"\n{OURS_NOT_THEIRS}\nreport: {folder / 'index.html'}; figures: figures.csv, table_1.csv, summary.json")
    return 0


def _settings(args: argparse.Namespace) -> Settings:
    if args.workers is not None and args.workers < 1:
        raise InputError(f"--workers {args.workers}: at least 1")
    draws = args.seeds if args.seeds is not None else QUICK_DRAWS if args.quick else Settings().draws
    return quick(args.seed, draws) if args.quick else replace(Settings(), base_seed=args.seed, draws=draws)


def _own_folder(folder: Path) -> Path:
    if folder.is_file():
        raise InputError(f"{folder}: is a file")
    if folder.exists() and any(folder.iterdir()) and not (folder / MARK).exists():
        raise InputError(f"{folder}: is not empty and was not made by truearc reproduce; name another with -o")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / MARK).touch()
    return folder
