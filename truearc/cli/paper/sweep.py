"""Train the paper's network with each amount and weight of simulated shots, with several seeds of each.

All are trained in one batch. Report which setting is best on shots that it did not learn from, and by how much.
"""

import argparse
import sys

import truearc as ta
from truearc.cli.common import listed, make_progress, number, refuse
from truearc.cli.outputs import OutFolder
from truearc.cli.paper.train import LAMBDA, add_recipe, data_of, recipe_of
from truearc.sim.paper.settings import DEFAULT_RECIPE as DEFAULT

WRITES = ("networks.csv", "settings.csv", "sweep.png", "best")
EXAMPLE = "truearc paper sweep --real shots/ --sim simulated/ --sizes 0,500,900 --lambdas 0.01,0.1 -o sweep/"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_recipe(parser, "dataset of simulated shots to draw from",
               "of the rest that decides when to stop and which setting is best")
    parser.add_argument("--sizes", type=listed(number(int, 0)), default="0,500,600,750,900,1000,1250",
                        metavar="N,N...", help="numbers of simulated shots (default: the paper's %(default)s)")
    parser.add_argument("--lambdas", type=listed(number(float)), metavar="L,L...",
                        help="weights of the simulated loss (default 0.01)")
    parser.add_argument("--seeds", type=number(int, 1), default=20,
                        help="networks of each setting, each with its own splits")
    parser.add_argument("--seed", type=number(int, 0), default=0, help="the first of them")
    parser.add_argument("--steps", type=int, default=DEFAULT.steps, help="minibatches at most")
    parser.add_argument("-o", "--out", type=OutFolder(WRITES), required=True, metavar="DIR", help="directory to write")


def main(args: argparse.Namespace) -> int:
    """Return 0 when the tables and the best network are written."""
    recipe = recipe_of(args)
    if not any(args.sizes):
        refuse(args, ("--sim", "--lambdas"), "--sizes takes no simulated shots")
    shares = ta.paper.Shares(args.holdout, args.validation)
    sweep = ta.paper.sweep_networks(**data_of(args), sizes=args.sizes, weights=args.lambdas or (LAMBDA,),
                                    seeds=args.seeds, recipe=recipe, shares=shares, seed=args.seed,
                                    progress=make_progress("sweep", args.quiet))
    for note in sweep.notes:
        print(note, file=sys.stderr)
    sweep.save(args.out)
    print(sweep)
    print(f"{args.out}: settings.csv, networks.csv, sweep.png; best/ holds the network of seed {args.seed} "
          f"({sweep.best.setting.words()}), for truearc export")
    return 0
