"""Print the paper's Table I, Table II and Figures 8 to 10 as reproduced on recordings of the emulated robot.

The paper's own numbers are printed beside the reproduced ones, with intervals, baselines and truearc's gate. Recordings
are kept, so that an interrupted run continues where it stopped.
"""

import argparse
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path

from truearc.cli.common import SHIPPED, make_progress, origin_of
from truearc.errors import InputError
from truearc_proof.reproduce import QUICK_DRAWS, Settings, quick

MARK = ".truearc-reproduce"           # a folder with this in it was made by us and may be gone on with
GROUP = "proof"
SUMMARY = "reproduce the paper's tables and figures"
EXAMPLE = "truearc reproduce -o reproduction --quick"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    defaults = Settings()
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="DIR", help="folder for all that is made")
    parser.add_argument("--seeds", type=int, metavar="N", help=f"repetitions that the intervals are over "
                        f"({defaults.draws}; {QUICK_DRAWS} with --quick)")
    parser.add_argument("--seed", type=int, default=defaults.base_seed, help="of all recordings and draws")
    parser.add_argument("--quick", action="store_true", help="minutes instead of an hour or more: everything is "
                        "there, but from too little data to conclude anything")
    parser.add_argument("--recordings", type=Path, metavar="DIR", help="recordings to use and to add to (default: "
                        "recordings/ in the output folder)")
    parser.add_argument("--workers", type=int, metavar="N", help="processes on this machine (default: one a core)")


def main(args: argparse.Namespace) -> int:
    """Return 0 when the report is written."""
    from truearc.robot.config.schema import load_config
    from truearc.sim.data.files import save_dataset
    from truearc_proof.parallel import fan_out
    from truearc_proof.reproduce import models, page
    from truearc_proof.reproduce.collect import collect, make_record
    settings = _settings(args)
    folder = _own_folder(args.out)
    progress = partial(make_progress, quiet=args.quiet)
    if not args.quiet:
        print(page.OURS_NOT_THEIRS, flush=True)
    record = make_record(args.recordings or folder / "recordings", args.workers, progress)
    pool = collect(load_config(SHIPPED), settings, record, progress("fit what to launch"))
    shutil.rmtree(folder / "data", ignore_errors=True)    # it follows from the recordings
    for name, part in (("real", pool.real), ("launched", pool.launched)):
        save_dataset(folder / "data" / name, part)
    repetitions = fan_out(models.run_repetition, models.tasks_of(pool, settings),
                          progress("fit and predict"), args.workers)
    answers = models.train_networks(repetitions, settings, progress("train networks"))
    analysis = models.analyse(repetitions, answers)
    tables = page.make_tables(repetitions, analysis, settings)
    page.save_figures(folder, pool, repetitions, analysis, tables, settings)
    page.save_page(folder / "index.html", pool, repetitions, analysis, tables, settings, origin_of(args))
    for line in [*(table.text() for table in page.in_short(tables)), "", *page.what_varies(pool, settings),
                 *page.headline(analysis)]:
        print(line)
    print(f"\n{page.OURS_NOT_THEIRS}\nreport: {folder / 'index.html'}; figures: figures.csv, summary.json")
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
