"""truearc train --model network: the seed's classifier."""

import argparse
import sys
from typing import Any

from truearc.cli.progress import make_progress
from truearc.robot.config.schema import InputError
from truearc.sim.data.dataset import dataset_hash, load_dataset
from truearc.sim.gate.network_training import Shares, rows_of, train_network
from truearc.sim.paper.sweep import Recipe, check_recipe
from truearc.sim.paper.synthetic_data import load_provenance
from truearc.sim.paper.training import Rows

NAME = "network"
DEFAULT = Recipe()


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    parser.add_argument("--sim", metavar="DIR", help="dataset of simulated shots; without it, recorded ones only")
    parser.add_argument("--lambda", dest="simulated_weight", type=float, default=0.01, metavar="L",
                        help="weight of the simulated loss (0.01)")
    parser.add_argument("--learning-rate", type=float, default=DEFAULT.learning_rate,
                        help=f"Adam's step ({DEFAULT.learning_rate:g})")
    parser.add_argument("--validation", type=float, default=0.25, metavar="SHARE",
                        help="share of the shots trained on that only says when to stop (0.25); 0 trains to the end")
    parser.add_argument("--patience", type=int, default=DEFAULT.patience, metavar="STEPS",
                        help=f"stop when so many steps have brought nothing better ({DEFAULT.patience})")
    length = parser.add_mutually_exclusive_group()
    length.add_argument("--steps", type=int, default=DEFAULT.steps, help=f"minibatches at most ({DEFAULT.steps})")
    length.add_argument("--epochs", type=int, help="times through the simulated shots at most, instead of --steps")


def main(args: argparse.Namespace) -> int:
    recipe = Recipe(args.learning_rate, args.steps, args.patience)
    check_recipe(recipe)
    if args.epochs is not None and args.epochs < 1:
        raise InputError(f"--epochs is {args.epochs}; at least 1 is needed")
    if args.seed < 0:
        raise InputError(f"--seed is {args.seed}; it cannot be negative")
    shares = Shares(args.holdout, args.validation, args.simulated_weight, args.epochs)
    simulated = load_dataset(args.sim) if args.sim else None
    network = train_network(load_dataset(args.real), simulated, coefficients=coefficients_of(args.sim), recipe=recipe,
                            shares=shares, seed=args.seed, progress=make_progress("train", args.quiet))
    for note in network.notes:
        print(note, file=sys.stderr)
    network.save(args.out)
    print("\n".join(network.report(args.out)))
    return 0


def coefficients_of(simulated: str | None) -> Any:
    """What the simulated shots of a directory were flown with; None without one."""
    return load_provenance(simulated).get("coefficients") if simulated else None


def load_rows(directory: str) -> Rows:
    """Rows of a dataset; what is left out is told on stderr, InputError when nothing is left."""
    rows, notes = rows_of(load_dataset(directory), directory)
    for note in notes:
        print(note, file=sys.stderr)
    return rows


def made_of(args: argparse.Namespace) -> dict[str, Any]:
    """What a record says of the data; args: `real`, `sim`, `holdout` and `validation` as typed."""
    return {"holdout": args.holdout, "validation": args.validation, "real_sha256": dataset_hash(args.real),
            "sim_sha256": dataset_hash(args.sim) if args.sim else None, "coefficients": coefficients_of(args.sim)}
