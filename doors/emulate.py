"""truearc emulate: the real runtime on the emulated robot."""

import argparse
from pathlib import Path

import robot
from doors.progress import make_progress
from doors.twin import emulate
from robot.config import BadInput, load_config
from sim.world.options import load_options

DESCRIPTION = "Record trials of the emulated robot: the real runtime, real frames and images, a MuJoCo world."
EXAMPLE = "truearc emulate --trials 50 --out sessions/first --world windy.toml --seed 7"
SHIPPED = Path(robot.__file__).parent / "launcher.toml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--trials", type=int, required=True, metavar="N")
    parser.add_argument("--out", type=Path, required=True, metavar="SESSION", help="folder to make")
    parser.add_argument("--config", type=Path, default=SHIPPED, help="launcher.toml (default: the shipped one)")
    parser.add_argument("--world", type=Path, help="world.toml; the robot never sees it (default: an honest world)")
    parser.add_argument("--gate", type=Path, help="model that must agree before the robot fires")
    parser.add_argument("--seed", type=int, default=0)


def main(args: argparse.Namespace) -> int:
    if args.trials < 1:
        raise BadInput(f"--trials {args.trials}: at least 1")
    if args.seed < 0:
        raise BadInput(f"--seed {args.seed}: cannot be negative")
    config = load_config(args.config)
    if config.gate.policy == "model" and args.gate is None:
        raise BadInput(f"{args.config}: gate.policy is 'model', so --gate is needed")
    results = emulate(config, args.out, args.trials, args.seed, load_options(args.world), args.gate,
                      make_progress("emulate", args.quiet))
    counts = {kind: sum(result.outcome == kind for result in results)
              for kind in ("three", "two", "miss-high", "miss-low")}
    print(f"{args.out}: {len(results)} balls launched (" + ", ".join(f"{n} {k}" for k, n in counts.items()) + ")")
    return 0
