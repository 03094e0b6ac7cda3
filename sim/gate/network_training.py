"""Training of the paper's network on recorded and simulated shots; sim/gate/train.py trains the physics-informed gate.

The record of a trained network includes the gate's novelty. This module is in sim/gate because sim/paper, which has the
network itself, must not import sim/gate.
"""

from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from truearc.sim.data.dataset import Dataset
from truearc.sim.data.files import hash_dataset
from truearc.sim.gate.model import fit_novelty, novelty_record
from truearc.sim.paper import Recipe
from truearc.sim.paper.network import Rows, accuracy, domain_of, save_weights, split_heldout, training_rows
from truearc.sim.paper.train_many import Job, Trained, batches_per_epoch, check_job, train_many
from truearc.sim.printed import Printed, Progress

CURVE_POINTS = 50                     # of a curve that is kept
# Derived: a share is then not known to an eighth
FEW_HELDOUT = 15                      # held-out shots, fewer than which are remarked on


@dataclass(frozen=True)
class Shares:
    """`holdout`: share of recorded shots to report on; `validation`: of the others, to say when to stop. `weight`: of
    the simulated loss. `epochs`: times through the simulated shots at most, instead of the recipe's steps; None: no."""

    holdout: float = 0.2
    validation: float = 0.25
    weight: float = 0.01
    epochs: int | None = None


@dataclass(frozen=True, eq=False)
class NetworkTraining(Printed):
    """A trained network; `score`: on training, validation and hold-out shots. `notes`: on excluded shots."""

    trained: Trained
    recipe: Recipe
    score: dict[str, Any]
    record: dict[str, Any]
    notes: tuple[str, ...]
    simulated: bool

    def save(self, directory: str | Path) -> None:
        """Write the weights directory; InputError if that fails."""
        save_weights(directory, self.trained.network, self.record)

    def lines(self) -> list[str]:
        """Return the accuracies, when training stopped, and warnings."""
        return self.report("network")

    def report(self, directory: str | Path) -> list[str]:
        """Return `lines` for weights that were written to a directory."""
        told = [_sentence("learnt from", self.score["train"])]
        if self.score["validation"]["shots"]:
            told.append(_sentence("watched for when to stop", self.score["validation"]))
        why = "no better after that" if self.trained.curve[-1].step < self.recipe.steps else "the last allowed"
        return [*told, _sentence("held out", self.score["heldout"]),
                f"{directory}: weights of step {self.trained.step} of {self.trained.curve[-1].step} ({why}); what "
                "counts is the line 'held out'", *(f"warning: {line}" for line in _careful(self.score, self.simulated))]


def train_network(real: Dataset, simulated: Dataset | None = None, *, coefficients: Any = None,
                  recipe: Recipe | None = None, shares: Shares | None = None, seed: int = 0,
                  progress: Progress = lambda done, note: None) -> NetworkTraining:
    """Train the paper's network (3-8-2, sigmoids) with its loss.

    Args:
        real: Recorded shots with outcome, distance_m [m], hood_deg [deg] and motor_ratio [1].
        simulated: Simulated shots; None: recorded ones only.
        coefficients: Behind the simulated shots, for the record.
        recipe: Step size, most steps and patience; None: the defaults.
        shares: Held-out shares and the weight of simulated shots; None: the defaults.
        seed: Of splits, first weights and batches.
        progress: Called with the share done, 0 to 1, and a note.

    Raises:
        InputError: a share or step that cannot be, or no usable shots.
    """
    recipe, shares = recipe or Recipe(), shares or Shares()
    rows, notes = rows_of(real, real.name)
    extra, more = (None, []) if simulated is None else rows_of(simulated, simulated.name)
    kept, heldout = split_heldout(rows, shares.holdout, seed)
    learnt, validation = split_heldout(kept, shares.validation, seed, "--validation")
    job = Job(learnt, extra, validation, shares.weight, seed)
    check_job(job)
    if shares.epochs is not None:
        batches = batches_per_epoch(len(learnt.features), 0 if extra is None else len(extra.features))
        recipe = Recipe(recipe.learning_rate, shares.epochs * batches, recipe.patience)
    trained = train_many([job], recipe, progress)[0]
    score = {name: accuracy(trained.network, part)
             for name, part in (("train", learnt), ("validation", validation), ("heldout", heldout))}
    made = {"holdout": shares.holdout, "validation": shares.validation, "real_sha256": hash_dataset(real),
            "sim_sha256": None if simulated is None else hash_dataset(simulated), "coefficients": coefficients}
    return NetworkTraining(trained, recipe, score, make_record(made, recipe, job, rows, score, trained),
                           (*notes, *more), simulated is not None)


def rows_of(dataset: Dataset, name: str) -> tuple[Rows, list[str]]:
    """Return the training rows, and a sentence for each kind of excluded shot and for outcomes that are all equal.

    Raises:
        InputError: no row is left.
    """
    rows, left_out = training_rows(dataset.shots, dataset.shots.source)
    if len(np.unique(rows.labels, axis=0)) < 2:
        left_out = [*left_out, f"{name}: warning: every shot has the same outcome; nothing can be told apart from that"]
    return rows, left_out


def make_record(made: dict[str, Any], recipe: Recipe, job: Job, real: Rows, score: dict[str, Any],
                trained: Trained) -> dict[str, Any]:
    """Return the content of training.json for a network.

    Args:
        made: holdout, validation, real_sha256, sim_sha256 and coefficients of the data.
    """
    curve = trained.curve             # at most CURVE_POINTS of it, evenly, the last one last
    marks = {round(len(curve) * (k + 1) / CURVE_POINTS) for k in range(CURVE_POINTS)} - {0}
    return {
        "version": version("truearc"), "seed": job.seed, "lambda": job.simulated_weight,
        "steps": trained.step, "epochs": trained.epoch, "most_steps": recipe.steps, "patience": recipe.patience,
        "learning_rate": recipe.learning_rate, "holdout": made["holdout"], "validation": made["validation"],
        "real_sha256": made["real_sha256"], "sim_sha256": made["sim_sha256"],
        "sim_shots": len(job.simulated.features) if job.simulated else 0, "coefficients": made["coefficients"],
        "accuracy": score, "domain": domain_of(real.features), "novelty": novelty_record(fit_novelty(real.features)),
        "curve": [[value if value == value else None for value in curve[mark - 1]] for mark in sorted(marks)],
    }


def _careful(score: dict[str, Any], simulated: bool) -> list[str]:
    """What keeps the figures from meaning much."""
    lines = []
    if score["heldout"]["shots"] < FEW_HELDOUT:
        lines.append(f"{score['heldout']['shots']} held-out shots say next to nothing about how good this is")
    if simulated:
        lines.append("if the coefficients behind the simulated shots were fitted to the held-out ones too, the figures "
                     "flatter; shots of another session do not")
    return lines


def _sentence(name: str, figures: dict[str, Any]) -> str:
    if not figures["shots"]:
        return f"{name}: no shots"
    return (f"{name}: {figures['shots']} shots, outcome right {figures['outcome']:.1%}, "
            f"two {figures['two']:.1%}, three {figures['three']:.1%}")
