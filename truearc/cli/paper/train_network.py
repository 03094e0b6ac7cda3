"""The work of `truearc paper train`: the paper's network, trained, kept and reported on."""

import argparse
import sys
from importlib.metadata import version
from typing import Any

import numpy as np

from truearc.cli.progress import make_progress
from truearc.robot.config.schema import InputError
from truearc.sim.data.dataset import dataset_hash, load_dataset
from truearc.sim.gate.novelty import fit_novelty, novelty_record
from truearc.sim.paper.network import save_weights
from truearc.sim.paper.settings import PATIENCE, Recipe, check_recipe
from truearc.sim.paper.sweep import Job, Trained, batches_per_epoch, check_job, train_many
from truearc.sim.paper.synthetic_data import load_provenance
from truearc.sim.paper.training import Rows, accuracy, domain_of, split_heldout, training_rows

CURVE_POINTS = 50
LAMBDA = 0.01                         # the paper's weight of the simulated loss
FEW = 15                              # held-out shots, fewer than which are remarked on


def run_training(args: argparse.Namespace) -> int:
    """Train, write the weights and report; args: those of `truearc paper train`."""
    check_recipe(_recipe_of(args, args.steps))
    if args.epochs is not None and args.epochs < 1:
        raise InputError(f"--epochs is {args.epochs}; at least 1 is needed")
    if args.seed < 0:
        raise InputError(f"--seed is {args.seed}; it cannot be negative")
    real = load_rows(args.real)
    simulated = load_rows(args.sim) if args.sim else None
    kept, heldout = split_heldout(real, args.holdout, args.seed)
    learnt, validation = split_heldout(kept, args.validation, args.seed, "--validation")
    weight = LAMBDA if args.simulated_weight is None else args.simulated_weight
    job = Job(learnt, simulated, validation, weight, args.seed)
    check_job(job)
    recipe = _recipe(args, job)
    trained = train_many([job], recipe, make_progress("train", args.quiet))[0]
    sets = {"train": learnt, "validation": validation, "heldout": heldout}
    score = {name: accuracy(trained.network, rows) for name, rows in sets.items()}
    save_weights(args.out, trained.network, make_record(args, recipe, job, real, score, trained))
    _tell(args, recipe, trained, score)
    return 0


def _recipe(args: argparse.Namespace, job: Job) -> Recipe:
    batches = batches_per_epoch(len(job.real.features), len(job.simulated.features) if job.simulated else 0)
    steps = args.steps if args.epochs is None else args.epochs * batches
    return _recipe_of(args, steps)


def _recipe_of(args: argparse.Namespace, steps: int) -> Recipe:
    return Recipe(args.learning_rate, steps, PATIENCE if args.patience is None else args.patience)


def _tell(args: argparse.Namespace, recipe: Recipe, trained: Trained, score: dict[str, Any]) -> None:
    """What was learnt, in words for someone who has only a spreadsheet."""
    print(_sentence("learnt from", score["train"]))
    if score["validation"]["shots"]:
        print(_sentence("watched for when to stop", score["validation"]))
    print(_sentence("held out", score["heldout"]))
    why = "no better after that" if trained.curve[-1].step < recipe.steps else "the last allowed"
    print(f"{args.out}: weights of step {trained.step} of {trained.curve[-1].step} ({why}); "
          f"what counts is the line 'held out'")
    for line in _careful(score, args.sim is not None):
        print(f"careful: {line}")


def _careful(score: dict[str, Any], simulated: bool) -> list[str]:
    """What keeps the figures above from meaning much."""
    lines = []
    if score["heldout"]["shots"] < FEW:
        lines.append(f"{score['heldout']['shots']} held-out shots say next to nothing about how good this is")
    if simulated:
        lines.append("if the coefficients behind the simulated shots were fitted to the held-out ones too, the figures "
                     "flatter; shots of another session do not")
    return lines


def load_rows(directory: str) -> Rows:
    """Rows of a dataset; what is left out is told on stderr, InputError when nothing is left."""
    shots = load_dataset(directory).shots
    rows, left_out = training_rows(shots, shots.source)
    if not len(rows.features):
        raise InputError("there is nothing to train on; " + "; ".join(left_out or [f"{shots.source}: no shots"]))
    for sentence in left_out:
        print(sentence, file=sys.stderr)
    if len(np.unique(rows.labels, axis=0)) < 2:
        print(f"{directory}: careful: every shot has the same outcome; nothing can be told apart from that",
              file=sys.stderr)
    return rows


def make_record(args: argparse.Namespace, recipe: Recipe, job: Job, real: Rows, score: dict[str, Any],
                trained: Trained) -> dict[str, Any]:
    """What training.json says of a network; args: `real`, `sim`, `holdout` and `validation` as given to the command."""
    return {
        "version": version("truearc"), "seed": job.seed, "lambda": job.simulated_weight,
        "steps": trained.step, "epochs": trained.epoch, "most_steps": recipe.steps, "patience": recipe.patience,
        "learning_rate": recipe.learning_rate, "holdout": args.holdout, "validation": args.validation,
        "real_sha256": dataset_hash(args.real),
        "sim_sha256": dataset_hash(args.sim) if args.sim else None,
        "sim_shots": len(job.simulated.features) if job.simulated else 0,
        "coefficients": load_provenance(args.sim).get("coefficients") if args.sim else None,
        "accuracy": score, "domain": domain_of(real.features),
        "novelty": novelty_record(fit_novelty(real.features)),
        "curve": [[value if value == value else None for value in point] for point in _thinned(trained.curve)],
    }


def _thinned(curve: tuple[Any, ...]) -> list[Any]:
    """At most CURVE_POINTS of a curve, evenly, the last one last."""
    marks = {round(len(curve) * (k + 1) / CURVE_POINTS) for k in range(CURVE_POINTS)} - {0}
    return [curve[mark - 1] for mark in sorted(marks)]


def _sentence(name: str, figures: dict[str, Any]) -> str:
    if not figures["shots"]:
        return f"{name}: no shots"
    return (f"{name}: {figures['shots']} shots, outcome right {figures['outcome']:.1%}, "
            f"two {figures['two']:.1%}, three {figures['three']:.1%}")
