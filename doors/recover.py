"""truearc recover: make a recording that was cut short whole."""

import argparse
from pathlib import Path

from robot.recording.recover import recover

DESCRIPTION = ("Make a recording that was cut short (power loss, kill, full disk) whole. Nothing that is whole is "
               "lost, and the damaged files are kept in SESSION/damaged.")
EXAMPLE = "truearc recover sessions/monday"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("session", type=Path, help="recorded session folder")


def main(args: argparse.Namespace) -> int:
    recovered = recover(args.session)
    counts = f"{recovered.ticks} ticks, {recovered.trials} trials"
    print(f"{args.session}: " + ("whole now" if recovered.repairs else "was whole") + f", {counts}")
    for repair in recovered.repairs:
        print(f"  {repair}")
    return 0
