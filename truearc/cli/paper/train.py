"""Train the paper's network (3-8-2, sigmoids) on recorded shots.

Each batch of them is paired with a batch of simulated ones whose loss is weighed by lambda.
"""

import argparse
import sys
from typing import TYPE_CHECKING, Any

import truearc as ta
from truearc.cli.common import add_accept, make_progress, number, refuse
from truearc.cli.outputs import WEIGHTS, OutFolder
from truearc.sim.paper.settings import DEFAULT_RECIPE as DEFAULT
from truearc.sim.paper.settings import PATIENCE

if TYPE_CHECKING:
    from truearc.api.paper import Recipe

LAMBDA = 0.01                         # the paper's weight of the simulated loss
EXAMPLE = "truearc paper train --real shots/ --sim simulated/ -o weights/"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_recipe(parser, "dataset of simulated shots; without it, recorded ones only",
               "of the shots trained on that decides when to stop; 0 trains to the end")
    parser.add_argument("--lambda", dest="simulated_weight", type=float, metavar="L",
                        help="weight of the simulated loss (default 0.01)")
    parser.add_argument("--seed", type=number(int, 0), default=0, help="seed of split, first weights and batches")
    length = parser.add_mutually_exclusive_group()
    length.add_argument("--steps", type=int, default=DEFAULT.steps, help="minibatches at most")
    length.add_argument("--epochs", type=number(int, 1),
                        help="times through the simulated shots at most, instead of --steps")
    parser.add_argument("-o", "--out", type=OutFolder(WEIGHTS), required=True, metavar="DIR",
                        help="weights directory to write")


def add_recipe(parser: argparse.ArgumentParser, simulated: str, validated: str) -> None:
    """Options of a training, also of `truearc paper sweep`; the texts say what --sim and --validation are."""
    parser.add_argument("--real", required=True, metavar="DIR", help="dataset of recorded shots")
    parser.add_argument("--sim", metavar="DIR", help=simulated)
    add_accept(parser)
    parser.add_argument("--holdout", type=float, default=0.2, metavar="SHARE",
                        help="share of recorded shots kept out of training, to report on")
    parser.add_argument("--validation", type=float, default=0.25, metavar="SHARE", help=f"share {validated}")
    parser.add_argument("--learning-rate", type=float, default=DEFAULT.learning_rate, help="Adam's step")
    parser.add_argument("--patience", type=number(int, 1), metavar="STEPS",
                        help=f"stop after this number of steps without improvement (default {DEFAULT.patience})")


def main(args: argparse.Namespace) -> int:
    """Return 0 when the weights are written."""
    if args.sim is None and args.simulated_weight is not None:
        raise ta.InputError("--lambda: applies with --sim only")
    if args.validation == 0.0:
        refuse(args, ("--patience",), "--validation 0 trains to the end; leave it out")
    weight = LAMBDA if args.simulated_weight is None else args.simulated_weight
    shares = ta.paper.Shares(args.holdout, args.validation, weight, args.epochs)
    network = ta.paper.train_network(**data_of(args), recipe=recipe_of(args), shares=shares, seed=args.seed,
                                     progress=make_progress("train", args.quiet))
    for note in network.notes:
        print(note, file=sys.stderr)
    network.save(args.out)
    print("\n".join(network.report(args.out)))
    return 0


def recipe_of(args: argparse.Namespace) -> "Recipe":
    """Return how to train, as the options of `add_recipe` and --steps say; InputError where that cannot be done."""
    return ta.paper.Recipe(args.learning_rate, args.steps, args.patience or PATIENCE)


def data_of(args: argparse.Namespace) -> dict[str, Any]:
    """Return the datasets of --real and --sim, and the coefficients that the simulated shots were flown with."""
    real = ta.paper.check_plausible(ta.load_dataset(args.real), args.accept)
    return {"real": real, "simulated": ta.load_dataset(args.sim) if args.sim else None,
            "coefficients": ta.paper.load_provenance(args.sim).get("coefficients") if args.sim else None}
