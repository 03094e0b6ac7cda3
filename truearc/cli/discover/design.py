"""Choose the next shots, or the measurement, that would best tell the remaining candidate terms apart.

Candidates are the terms that `truearc discover` leaves; the shots are some that the robot can take. Say, too, how
likely they are to decide.
"""

import argparse

import truearc as ta
from truearc.cli.common import number, write_out
from truearc.cli.discover.discover import add_baseline, investigate
from truearc.cli.outputs import out_file
from truearc.sim.discover.finding import CONFIGURATIONS, PLANNED_SHOTS

EXAMPLE = "truearc design shots/ --shots 100 --json next.json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("dataset", metavar="DIR", help="dataset directory")
    add_baseline(parser)
    parser.add_argument("--shots", type=number(int, 1), default=PLANNED_SHOTS, metavar="N", help="shots to plan")
    parser.add_argument("--configurations", type=number(int, 1), default=CONFIGURATIONS, metavar="K",
                        help="that they are shared out to")
    parser.add_argument("--json", type=out_file, metavar="FILE", help="write the plan as JSON")


def main(args: argparse.Namespace) -> int:
    """Return 0, whether or not there is anything to tell apart."""
    if args.configurations > args.shots:
        raise ta.InputError(f"--shots {args.shots}, --configurations {args.configurations}: at least one shot each")
    dataset, found = investigate(args, "design")
    plan = ta.design_shots(dataset, found, shots=args.shots, configurations=args.configurations, seed=args.seed)
    print(plan)
    write_out(args.json, plan.to_json())
    return 0
