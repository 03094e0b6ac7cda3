"""The work of `truearc paper train`: train the paper's network, save it and report on it."""

import argparse
import sys
from typing import Any

from truearc.cli.common import make_progress
from truearc.sim.data.dataset import hash_dataset, load_dataset
from truearc.sim.gate.network_training import Shares, rows_of, train_network
from truearc.sim.paper.settings import PATIENCE, Recipe
from truearc.sim.paper.synthetic_shots import load_provenance
from truearc.sim.paper.training import Rows

LAMBDA = 0.01                         # the paper's weight of the simulated loss


def run_training(args: argparse.Namespace) -> int:
    """Train, write the weights and report; args: those of `truearc paper train`."""
    recipe = recipe_of(args)
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


def recipe_of(args: argparse.Namespace) -> Recipe:
    """Return how to train, as the options of `add_recipe` and --steps say; InputError where that cannot be done."""
    return Recipe(args.learning_rate, args.steps, args.patience or PATIENCE)


def coefficients_of(simulated: str | None) -> Any:
    """Return the coefficients that the simulated shots of a directory were flown with; None without one."""
    return load_provenance(simulated).get("coefficients") if simulated else None


def load_rows(directory: str) -> Rows:
    """Return the rows of a dataset and report on stderr what is left out; InputError when nothing is left."""
    rows, notes = rows_of(load_dataset(directory), directory)
    for note in notes:
        print(note, file=sys.stderr)
    return rows


def made_of(args: argparse.Namespace) -> dict[str, Any]:
    """Return the part of a record that describes the data; args: `real`, `sim`, `holdout` and `validation` as typed."""
    hashes = [hash_dataset(load_dataset(path)) if path else None for path in (args.real, args.sim)]
    return {"holdout": args.holdout, "validation": args.validation, "real_sha256": hashes[0], "sim_sha256": hashes[1],
            "coefficients": coefficients_of(args.sim)}
