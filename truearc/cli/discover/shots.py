"""Turn recorded sessions into a dataset of shots (rig.toml, shots.csv, traces.csv)."""

import argparse
import sys
from pathlib import Path

import truearc as ta
from truearc.cli.common import make_progress
from truearc.cli.outputs import DATASET, OutFolder

EXAMPLE = "truearc shots sessions/monday sessions/tuesday -o data/week"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("sessions", type=Path, nargs="+", metavar="SESSION", help="recorded session folder")
    parser.add_argument("-o", "--out", type=OutFolder(DATASET), required=True, metavar="DIR",
                        help="dataset folder to write")
    parser.add_argument("--repeatability", action="store_true",
                        help="one row a configuration, labelled by the paper's R2/R3 rule (section IV-A)")


def main(args: argparse.Namespace) -> int:
    """Return 0 once the dataset is written."""
    from truearc.sim.data.recordings import label_by_repeatability
    progress = make_progress("shots", args.quiet)
    dataset = ta.shots_from_sessions(args.sessions, args.out.name)
    progress(0.8, "read")
    if args.repeatability:
        dataset = label_by_repeatability(dataset)
    ta.save_dataset(args.out, dataset)
    progress(1.0, f"{len(dataset.shots)} rows")
    outcomes = dataset.shots.text("outcome")
    counts = ", ".join(f"{outcomes.count(kind)} {kind}" for kind in ("three", "two", "miss"))
    print(f"{args.out}: {len(dataset.shots)} shots ({counts}); {len(dataset.left_out)} left out")
    for line in [] if args.quiet else dataset.left_out:
        print(f"  left out: {line}", file=sys.stderr)
    return 0
