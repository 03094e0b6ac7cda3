"""The work of `truearc paper train`: the paper's network, trained, kept and reported on."""

import argparse
import sys
from typing import Any

from truearc.cli.progress import make_progress
from truearc.robot.config.schema import InputError
from truearc.sim.data.dataset import dataset_hash, load_dataset
from truearc.sim.gate.network_training import Shares, rows_of, train_network
from truearc.sim.paper.settings import PATIENCE, Recipe
from truearc.sim.paper.synthetic_shots import load_provenance
from truearc.sim.paper.training import Rows

LAMBDA = 0.01                         # the paper's weight of the simulated loss


def run_training(args: argparse.Namespace) -> int:
    """Train, write the weights and report; args: those of `truearc paper train`."""
    recipe = Recipe(args.learning_rate, args.steps, PATIENCE if args.patience is None else args.patience)
    if args.epochs is not None and args.epochs < 1:
        raise InputError(f"--epochs is {args.epochs}; at least 1 is needed")
    if args.seed < 0:
        raise InputError(f"--seed is {args.seed}; it cannot be negative")
    weight = LAMBDA if args.simulated_weight is None else args.simulated_weight
    shares = Shares(args.holdout, args.validation, weight, args.epochs)
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
