"""truearc train --model network: the seed's classifier."""

import argparse
import sys
from importlib.metadata import version
from typing import Any

from doors.progress import make_progress
from robot.config import BadInput
from sim.gate.novelty import fit_novelty, novelty_record
from sim.network import save_weights
from sim.shots import dataset_hash, load_dataset
from sim.synth import load_provenance
from sim.train import (
    EPOCHS,
    CurvePoint,
    Recipe,
    Rows,
    accuracy,
    check_recipe,
    domain_of,
    split_heldout,
    train,
    training_rows,
)

NAME = "network"


def add_arguments(parser: argparse._ArgumentGroup) -> None:
    parser.add_argument("--sim", metavar="DIR", help="dataset of simulated shots; without it, recorded ones only")
    parser.add_argument("--lambda", dest="simulated_weight", type=float, default=0.01, metavar="L",
                        help="weight of the simulated loss (0.01)")
    parser.add_argument("--epochs", type=int, default=EPOCHS, help=f"times through the simulated shots ({EPOCHS})")
    parser.add_argument("--learning-rate", type=float, default=1e-4, help="Adam's step (1e-4)")


def main(args: argparse.Namespace) -> int:
    recipe = Recipe(args.simulated_weight, args.learning_rate, args.epochs, args.seed)
    check_recipe(recipe)
    real = _load_rows(args.real)
    simulated = _load_rows(args.sim) if args.sim else None
    kept, heldout = split_heldout(real, args.holdout, args.seed)
    network, curve = train(kept, simulated, recipe, heldout, make_progress("train", args.quiet))
    score = {"train": accuracy(network, kept), "heldout": accuracy(network, heldout)}
    save_weights(args.out, network, _record(args, recipe, real, score, curve))
    for name, figures in score.items():
        print(_sentence(name, figures))
    print(f"{args.out}: trained for {recipe.epochs} epochs; final loss {curve[-1].real:.4f}")
    return 0


def _load_rows(directory: str) -> Rows:
    rows, left_out = training_rows(load_dataset(directory).shots, directory)
    for sentence in left_out:
        print(sentence, file=sys.stderr)
    if not len(rows.features):
        raise BadInput(f"{directory}: no shot has an outcome and all features; there is nothing to train on")
    return rows


def _record(args: argparse.Namespace, recipe: Recipe, real: Rows, score: dict[str, Any],
            curve: list[CurvePoint]) -> dict[str, Any]:
    return {
        "version": version("truearc"), "seed": recipe.seed, "lambda": recipe.simulated_weight,
        "epochs": recipe.epochs, "learning_rate": recipe.learning_rate, "holdout": args.holdout,
        "real_sha256": dataset_hash(args.real),
        "sim_sha256": dataset_hash(args.sim) if args.sim else None,
        "coefficients": load_provenance(args.sim).get("coefficients") if args.sim else None,
        "accuracy": score, "domain": domain_of(real.features),
        "novelty": novelty_record(fit_novelty(real.features)),
        "curve": [[value if value == value else None for value in point] for point in curve],
    }


def _sentence(name: str, figures: dict[str, Any]) -> str:
    if not figures["shots"]:
        return f"{name}: no shots"
    return (f"{name}: {figures['shots']} shots, outcome right {figures['outcome']:.1%}, "
            f"two {figures['two']:.1%}, three {figures['three']:.1%}")
