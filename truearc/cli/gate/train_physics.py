"""truearc train --model physics: the gate that takes the physics in."""

import argparse
import sys
from pathlib import Path

import truearc as ta
from truearc.cli.progress import make_progress
from truearc.robot.config.schema import InputError

NAME = "physics"


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    """Options of this model."""
    parser.add_argument("--coefficients", metavar="FILE",
                        help="coefficients.toml, as `truearc fit` writes it; by --method ml it knows the scatter too. "
                             "All recorded shots are learned from; what that is worth is found by leaving out each "
                             "fifth of the configurations in turn, so --holdout has no say")
    parser.add_argument("--reliability", metavar="FILE", help="picture of stated against true shares to write")


def main(args: argparse.Namespace) -> int:
    """Return 0 once the weights are written."""
    _check(args)
    belief, dataset = ta.load_belief(args.coefficients), ta.load_dataset(args.real)
    trained = ta.train_gate(dataset, belief, seed=args.seed, progress=make_progress("train", args.quiet))
    for sentence in trained.left_out:
        print(sentence, file=sys.stderr)
    trained.save(args.out)
    print(trained)
    if args.reliability is not None and trained.folds is not None:
        from truearc.sim.report import make_png
        Path(args.reliability).write_bytes(make_png(trained.plot_reliability()))
        print(f"{args.reliability}: stated against true shares")
    print(f"{args.out}: the gate; next: truearc export {args.out} -o gate.onnx")
    return 0


def _check(args: argparse.Namespace) -> None:
    if args.coefficients is None:
        raise InputError("--coefficients: --model physics needs the coefficients.toml of a fit")
    if args.seed < 0:
        raise InputError(f"--seed is {args.seed}; it cannot be negative")
    if args.reliability is not None and not Path(args.reliability).parent.is_dir():
        raise InputError(f"{args.reliability}: there is no directory to write it to")
