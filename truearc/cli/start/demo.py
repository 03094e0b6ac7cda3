"""truearc demo: the whole loop on the emulated robot, and one report."""

import argparse
from pathlib import Path

from truearc.robot.config.schema import InputError

DESCRIPTION = """The whole loop on the emulated robot: record, fit, simulate, train, export, verify, say where
simulation and recordings disagree, put what was found into the simulation, drive with the gate of before, with that of
after and without one, and write one report."""
EXAMPLE = "truearc demo --out report"
FEWEST = 30


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, default=Path("report"), help="folder for the report and all it rests on")
    parser.add_argument("--trials", type=int, default=120, help="trials recorded to learn from")
    parser.add_argument("--test-trials", type=int, default=120, help="trials of the gated and of the ungated session")
    parser.add_argument("--seed", type=int, default=2026, help="seed of everything drawn (default %(default)s)")


def main(args: argparse.Namespace) -> int:
    """Return 0 when the report is written."""
    if args.seed < 0:
        raise InputError(f"--seed {args.seed}: cannot be negative")
    if min(args.trials, args.test_trials) < FEWEST:
        raise InputError(f"--trials and --test-trials: at least {FEWEST}, or there is nothing to learn from")
    from truearc.cli.start.demo_loop import run_demo
    return run_demo(args)
