"""Simulate shots for the classifier, balanced over the three outcomes.

Every configuration of the paper's grid is flown with fitted coefficients, and an even sample is drawn. With --draws
each shot has coefficients of its own, drawn from the covariance that `truearc fit` writes, and the scatter and sensor
noise of a real shot.
"""

import argparse

import truearc as ta
from truearc.cli.common import add_terms_from, catalogue_of, make_progress, number
from truearc.cli.outputs import DATASET, OutFolder

WRITES = ("coefficients.toml", "synth.json")
EXAMPLE = "truearc paper synth --rig rig.toml --coefficients coefficients.toml -n 900 --exclude shots/ -o simulated/"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--rig", required=True, help="rig.toml")
    parser.add_argument("--coefficients", required=True, metavar="FILE",
                        help="coefficients.toml, as `truearc fit` and `truearc paper fit` write it")
    add_terms_from(parser)
    parser.add_argument("-n", type=int, default=900, help="shots in all")
    parser.add_argument("--draws", type=number(int, 1), metavar="N",
                        help="draw N sets of coefficients from the fit's covariance, and scatter every shot; without "
                             "it one exact set, as in the paper")
    parser.add_argument("--exclude", metavar="DIR", help="dataset of recorded shots whose configurations are not drawn")
    parser.add_argument("--seed", type=number(int, 0), default=0, help="of the draw")
    parser.add_argument("-o", "--out", type=OutFolder((*DATASET, *WRITES)), required=True, metavar="DIR",
                        help="dataset directory to write")


def main(args: argparse.Namespace) -> int:
    """Return 0 when the dataset is written."""
    recorded = ta.load_dataset(args.exclude) if args.exclude else None
    shots = ta.paper.write_synthetic(args.out, ta.load_rig(args.rig), args.coefficients, args.n, exclude=recorded,
                                     draws=args.draws, seed=args.seed, among=catalogue_of(args),
                                     progress=make_progress("synth", args.quiet))
    print(ta.paper.say_synthetic(args.out, shots, args.draws))
    return 0
