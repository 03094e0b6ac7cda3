"""Simulated shots as a dataset directory, with the coefficients behind them and how they were drawn."""

import json
import shutil
from importlib.metadata import version
from pathlib import Path

from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.columns import OUTCOMES
from truearc.sim.data.dataset import Dataset, Shots, check_free, hash_dataset, save_dataset
from truearc.sim.infer.belief import load_belief
from truearc.sim.paper.synthetic_data import PROVENANCE_FILE, SHAPE, synthesise
from truearc.sim.paper.synthetic_draws import check_belief, synthesise_draws
from truearc.sim.physics.catalogue import Catalogue
from truearc.sim.progress import Progress


def write_synthetic(directory: str | Path, rig: Rig, coefficients: str | Path, n: int, *,
                    exclude: Dataset | None = None, draws: int | None = None, seed: int = 0,
                    among: Catalogue | None = None, progress: Progress = lambda done, note: None) -> Shots:
    """Simulate shots of the paper's grid of configurations, write them as a dataset, and return them.

    Args:
        directory: To write; new or empty.
        rig: That the shots are made with.
        coefficients: coefficients.toml to fly with; it is copied into the directory.
        n: Shots in all, the same number of each outcome.
        exclude: Recorded shots whose configurations are not drawn.
        draws: Sets of coefficients drawn from the covariance, with launch scatter and sensor noise; None: one exact
            set, as in the paper.
        seed: Of the draw.
        among: The catalogue of the terms.
        progress: Called with the share done, 0 to 1, and a note.

    Raises:
        InputError: the directory is not empty, the file is not coefficients, or there are too few configurations.
    """
    out = check_free(directory)
    belief = load_belief(coefficients, among)
    recorded = None if exclude is None else exclude.shots
    if draws is None:
        shots = synthesise(rig, belief, n, recorded, seed, progress)
    else:
        check_belief(belief, str(coefficients))
        shots = synthesise_draws(rig, belief, draws, n, recorded, seed, progress)
    save_dataset(out, Dataset(out.name, rig, shots))
    shutil.copyfile(coefficients, out / "coefficients.toml")
    provenance = {"version": version("truearc"), "seed": seed, "coefficients": belief.coefficients, "draws": draws,
                  "scatter": belief.scatter if draws else None,
                  "excluded_sha256": None if exclude is None else hash_dataset(exclude)}
    (out / PROVENANCE_FILE).write_text(json.dumps(provenance, indent=1) + "\n", encoding="utf-8")
    return shots


def say_synthetic(directory: str | Path, shots: Shots, draws: int | None = None) -> str:
    """Return how many shots of which outcome were written."""
    counts = ", ".join(f"{shots.text('outcome').count(outcome)} {outcome}" for outcome in OUTCOMES)
    more = f"; each with one of {draws} sets of coefficients, launch scatter and sensor noise" if draws else ""
    return (f"{directory}: {len(shots)} simulated shots of {SHAPE[0] * SHAPE[1] * SHAPE[2]} configurations: "
            f"{counts}{more}")
