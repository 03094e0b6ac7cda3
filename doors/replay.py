"""truearc replay: recompute every output of a recording."""

import argparse
import sys
from pathlib import Path

from robot.recording.replay import Difference, replay

DESCRIPTION = "Recompute every output of a recording from its inputs; exit 1 on the first difference."
EXAMPLE = "truearc replay sessions/monday --check"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("session", type=Path, help="recorded session folder")
    parser.add_argument("--check", action="store_true", help="fail on a recording that was cut short, too")


def main(args: argparse.Namespace) -> int:
    try:
        ticks, cut_short = replay(args.session)
    except Difference as difference:
        print(f"{args.session}: {difference}", file=sys.stderr)
        return 1
    print(f"{args.session}: {ticks} ticks replayed, every output bit-equal")
    if cut_short:
        print(cut_short, file=sys.stderr)
    return 1 if cut_short and args.check else 0
