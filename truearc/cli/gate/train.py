"""Train a gate on recorded shots: the fitted physics, a small learned correction, and a calibrated spread.

All recorded shots are learned from; each fifth of the configurations is left out in turn to measure the gate on shots
that it has not seen. The paper's network is `truearc paper train`.
"""

import argparse
import sys

import truearc as ta
from truearc.cli.common import add_accept, make_progress, number
from truearc.cli.outputs import WEIGHTS, OutFolder, out_file
from truearc.errors import save_whole

EXAMPLE = "truearc train --real shots/ --coefficients coefficients.toml -o weights/"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--real", required=True, metavar="DIR", help="dataset of recorded shots")
    parser.add_argument("--coefficients", required=True, metavar="FILE",
                        help="coefficients.toml, as `truearc fit` (with the scatter), `truearc discover --adopt` or "
                             "`truearc paper fit` write it")
    parser.add_argument("--reliability", type=out_file, metavar="FILE",
                        help="picture of predicted against observed shares to write")
    add_accept(parser)
    parser.add_argument("--seed", type=number(int, 0), default=0, help="seed of split and first weights")
    parser.add_argument("-o", "--out", type=OutFolder(WEIGHTS), required=True, metavar="DIR",
                        help="weights directory to write")


def main(args: argparse.Namespace) -> int:
    """Return 0 once the weights are written."""
    belief, dataset = ta.load_belief(args.coefficients), ta.load_dataset(args.real)
    trained = ta.train_gate(dataset, belief, seed=args.seed, accept=args.accept,
                            progress=make_progress("train", args.quiet))
    for sentence in trained.left_out:
        print(sentence, file=sys.stderr)
    trained.save(args.out)
    print(trained)
    if args.reliability is not None and trained.folds is not None:
        from truearc.sim.report import make_png
        save_whole(args.reliability, make_png(trained.plot_reliability()))
        print(f"{args.reliability}: stated against true shares")
    print(f"{args.out}: the gate; next: truearc export {args.out} -o gate.onnx")
    return 0
