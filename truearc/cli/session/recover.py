"""Make a recording that was cut short (power loss, kill, full disk) whole.

Nothing that is whole is lost, and the damaged files are kept in SESSION/damaged.
"""

import argparse
import sys
from pathlib import Path

EXAMPLE = "truearc session recover sessions/monday"
PROGRESS = False


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("session", type=Path, help="recorded session folder")


def main(args: argparse.Namespace) -> int:
    """Return 0 when the recording is whole."""
    from truearc.robot.recording.recover import recover
    from truearc.robot.recording.session import CAN, INDEX
    recovered = recover(args.session)
    absent = [name for name in (CAN, INDEX) if not (args.session / name).exists()]
    counts = f"{recovered.ticks} ticks, {recovered.trials} trials"
    print(f"{args.session}: " + ("whole now" if recovered.repairs else "was whole") + f", {counts}")
    for repair in recovered.repairs:
        print(f"  {repair}")
    for name in absent:
        print(f"  {name} is not there, and cannot be made again", file=sys.stderr)
    return 0
