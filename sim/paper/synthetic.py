"""The paper's simulated shots (III-B): a grid of configurations that is flown, labelled and sampled evenly by outcome.

The paper mentions 375,000 configurations; its stated ranges and steps, taken inclusively, give 101 x 61 x 76 = 468,236,
and all of these are flown.
"""

import json
import math
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.targets import refuse_up
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.data.files import check_free, hash_dataset, save_dataset
from truearc.sim.data.table import OUTCOMES
from truearc.sim.infer.belief import Belief, Curves, before_the_shot, load_belief
from truearc.sim.paper.network import load_json
from truearc.sim.physics.catalogue import Catalogue
from truearc.sim.physics.simulate import classify, opening_of, predict
from truearc.sim.printed import Progress

NONE: Curves = {}
STEP_S = 0.01                         # heights then agree with the simulator's own finer step to 1e-6 m
PROVENANCE_FILE = "synth.json"


@dataclass(frozen=True)
class Axis:
    """Evenly spaced values: low, low + 1 / per_unit, ... (`count` of them)."""

    name: str
    low: float
    per_unit: int                     # values per unit; its inverse, the paper's step, is not exact in binary
    count: int

    def values(self) -> np.ndarray:
        """Return all values, each the float nearest to its decimal."""
        return (round(self.low * self.per_unit) + np.arange(self.count)) / self.per_unit

    def nearest(self, values: np.ndarray) -> np.ndarray:
        """Return the index of the grid value nearest to each value; -1 if it is more than half a step outside the
        axis."""
        index = np.rint((values - self.low) * self.per_unit)
        return np.where((index >= 0) & (index < self.count), index, -1).astype(np.int64)


AXES = (Axis("motor_ratio", 0.0, 100, 101), Axis("hood_deg", 15.0, 1, 61), Axis("distance_m", 1.0, 5, 76))
SHAPE = tuple(axis.count for axis in AXES)


def grid_shots(index: np.ndarray) -> Shots:
    """Return the configurations at flat positions of the grid (motor_ratio slowest, distance_m fastest)."""
    places = np.unravel_index(index, SHAPE)
    numbers = {axis.name: axis.values()[place] for axis, place in zip(AXES, places, strict=True)}
    return Shots(tuple(f"sim-{position:06d}" for position in index), numbers, {})


def label_grid(rig: Rig, coefficients: Mapping[str, Mapping[str, float]],
               progress: Progress = lambda done, note: None, curves: Curves = NONE,
               among: Catalogue | None = None) -> np.ndarray:
    """Return the outcome of every configuration of the grid, flat, from the simulator with gravity and these terms.

    Some of the terms may go with curves. among: the catalogue of the terms, truearc.sim.physics.catalogue.catalogue()
    when not given. InputError when the rig has no target, or cannot turn a motor ratio into a launch.
    """
    refuse_up(rig.target, "the paper's method")
    opening = opening_of(rig, coefficients, among)     # a rig without target: no work
    shots = grid_shots(np.arange(np.prod(SHAPE)))
    flown = predict(rig, coefficients, shots, progress, before_the_shot(curves, rig, shots), among, STEP_S)
    return classify(rig, np.asarray(flown.height_m), opening)


def taken_configurations(shots: Shots) -> np.ndarray:
    """Return flat positions of the grid nearest to recorded shots; none for a shot that lacks one of the three
    columns."""
    known = np.all([np.isfinite(shots.number(axis.name)) for axis in AXES], axis=0)
    places = np.stack([axis.nearest(shots.number(axis.name)[known]) for axis in AXES])
    return np.unique(np.ravel_multi_index(tuple(places[:, (places >= 0).all(axis=0)]), SHAPE))


def sample_balanced(outcomes: np.ndarray, count: int, taken: np.ndarray, seed: int) -> np.ndarray:
    """Draw `count` flat positions by seed, ascending, as even by outcome as possible, none of them in `taken`.

    What does not divide by three goes to miss first, then two. InputError when an outcome is too rare for its share.
    """
    check_draw(count, seed)
    rng = np.random.default_rng(seed)
    free = np.ones(len(outcomes), bool)
    free[taken] = False
    chosen = []
    for rank, outcome in enumerate(OUTCOMES):
        share = (count + len(OUTCOMES) - 1 - rank) // len(OUTCOMES)
        pool = np.flatnonzero(free & (outcomes == outcome))
        if len(pool) < share:
            raise InputError(f"only {len(pool)} configurations of the grid are a {outcome!r} with these coefficients, "
                           f"and -n {count} asks for {share}")
        chosen.append(rng.choice(pool, share, replace=False))
    return np.sort(np.concatenate(chosen))


def check_draw(count: int, seed: int) -> None:
    """Raise InputError naming the option with which no sample can be drawn."""
    if count < len(OUTCOMES):
        raise InputError(f"-n is {count}; at least {len(OUTCOMES)} shots are needed, one of each outcome")
    if seed < 0:
        raise InputError(f"--seed is {seed}; it cannot be negative")


def sample_shots(outcomes: np.ndarray, count: int, recorded: Shots | None, seed: int) -> Shots:
    """Sample shots with an outcome each from the grid's outcomes, none at a configuration that `recorded` has."""
    taken = np.zeros(0, np.int64) if recorded is None else taken_configurations(recorded)
    shots = grid_shots(index := sample_balanced(outcomes, count, taken, seed))
    return Shots(shots.shot_id, shots.numbers, {"outcome": tuple(map(str, outcomes[index]))})


def write_synthetic(directory: str | Path, rig: Rig, coefficients: str | Path, n: int, *,
                    exclude: Dataset | None = None, seed: int = 0, among: Catalogue | None = None,
                    progress: Progress = lambda done, note: None) -> Shots:
    """Simulate shots of the paper's grid of configurations, write them as a dataset, and return them.

    Args:
        directory: To write; new or empty.
        rig: That the shots are made with.
        coefficients: coefficients.toml to fly with; it is copied into the directory.
        n: Shots in all, the same number of each outcome.
        exclude: Recorded shots whose configurations are not drawn.
        seed: Of the draw.
        among: The catalogue of the terms.
        progress: Called with the share done, 0 to 1, and a note.

    Raises:
        InputError: the directory is not empty, the file is not coefficients, or there are too few configurations.
    """
    out = check_free(directory)
    belief = load_belief(coefficients, among)
    shots = synthesise(rig, belief, n, None if exclude is None else exclude.shots, seed, progress)
    save_dataset(out, Dataset(out.name, rig, shots))
    shutil.copyfile(coefficients, out / "coefficients.toml")
    provenance = {"version": version("truearc"), "seed": seed, "coefficients": belief.coefficients,
                  "excluded_sha256": None if exclude is None else hash_dataset(exclude)}
    (out / PROVENANCE_FILE).write_text(json.dumps(provenance, indent=1) + "\n", encoding="utf-8")
    return shots


def load_provenance(directory: str | Path) -> dict[str, Any]:
    """Read the provenance of a simulated dataset; empty when the directory holds none."""
    path = Path(directory) / PROVENANCE_FILE
    return load_json(path) if path.is_file() else {}


def say_synthetic(directory: str | Path, shots: Shots) -> str:
    """Return how many shots of which outcome were written."""
    counts = ", ".join(f"{shots.text('outcome').count(outcome)} {outcome}" for outcome in OUTCOMES)
    return (f"{directory}: {len(shots)} simulated shots of {math.prod(axis.count for axis in AXES)} "
            f"configurations: {counts}")


def synthesise(rig: Rig, belief: Belief, count: int, recorded: Shots | None, seed: int,
               progress: Progress = lambda done, note: None) -> Shots:
    """Simulated shots with an outcome each, by the belief's own coefficients, none at a configuration that `recorded`
    has; same arguments, same shots. InputError when the count is too small."""
    check_draw(count, seed)                      # before the work, not after it
    outcomes = label_grid(rig, belief.coefficients, progress, belief.curves, belief.catalogue)
    return sample_shots(outcomes, count, recorded, seed)
