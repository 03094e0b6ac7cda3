"""The work of `truearc reproduce`: records, fits, trains, and writes tables and page."""

import argparse
import shutil
from dataclasses import replace
from pathlib import Path

from truearc.cli.common import SHIPPED, make_progress, origin_of
from truearc.errors import InputError
from truearc.robot.config.schema import load_config
from truearc.sim.data.files import save_dataset
from truearc.sim.printed import Progress
from truearc_proof.cli.reproduce_record import make_record
from truearc_proof.parallel import fan_out
from truearc_proof.reproduce.analysis import analyse
from truearc_proof.reproduce.collect import Pool, collect
from truearc_proof.reproduce.networks import train_networks
from truearc_proof.reproduce.page import OURS_NOT_THEIRS, headline, save_figures, save_page, what_varies
from truearc_proof.reproduce.repetition import run_repetition, tasks_of
from truearc_proof.reproduce.settings import QUICK_DRAWS, Settings, quick
from truearc_proof.reproduce.tables import in_short, make_tables

MARK = ".truearc-reproduce"           # a folder with this in it was made by us and may be gone on with


def reproduce(args: argparse.Namespace) -> int:
    """Make every table and figure; args: those of `truearc reproduce`."""
    settings = _settings(args)
    folder = _own_folder(args.out)

    def progress(what: str) -> Progress:
        return make_progress(what, args.quiet)

    _say(args, OURS_NOT_THEIRS)
    record = make_record(args.recordings or folder / "recordings", args.scheduler, args.workers, progress)
    pool = collect(load_config(SHIPPED), settings, record, progress("fit what to launch"))
    _save_pool(folder / "data", pool)
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


def _save_pool(folder: Path, pool: Pool) -> None:
    """Write the labelled configurations as datasets; they follow from the recordings, so old ones are replaced."""
    shutil.rmtree(folder, ignore_errors=True)
    save_dataset(folder / "real", pool.real)
    save_dataset(folder / "launched", pool.launched)


def _say(args: argparse.Namespace, text: str) -> None:
    if not args.quiet:
        print(text, flush=True)
