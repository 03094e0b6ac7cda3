"""The paper's simulated shots, and a sweep over their amounts and weights: who is trained on what, and what came of it.

Configurations of the paper's grid are flown, labelled, sampled evenly by outcome (III-B), and written.
The paper speaks of 375,000 configurations; the ranges and steps that it states, taken inclusively, are
101 x 61 x 76 = 468,236, and those are flown.
"""

import json
import math
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.data.files import check_free, hash_dataset, save_dataset
from truearc.sim.data.table import OUTCOMES
from truearc.sim.infer.belief import Belief, Curves, before_the_shot, load_belief
from truearc.sim.paper.network import Rows, accuracy, load_json, mean_loss, split_heldout
from truearc.sim.paper.train_many import Job, Trained
from truearc.sim.physics.catalogue import Catalogue
from truearc.sim.physics.simulate import classify, opening_of, predict
from truearc.sim.printed import Progress
from truearc.sim.report import new_panels
from truearc.sim.statistics import student_half

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
        """All values, each the float nearest to its decimal."""
        return (round(self.low * self.per_unit) + np.arange(self.count)) / self.per_unit

    def nearest(self, values: np.ndarray) -> np.ndarray:
        """Index of the grid value nearest to each value; -1 where it is further than half a step outside the axis."""
        index = np.rint((values - self.low) * self.per_unit)
        return np.where((index >= 0) & (index < self.count), index, -1).astype(np.int64)


AXES = (Axis("motor_ratio", 0.0, 100, 101), Axis("hood_deg", 15.0, 1, 61), Axis("distance_m", 1.0, 5, 76))
SHAPE = tuple(axis.count for axis in AXES)


def grid_shots(index: np.ndarray) -> Shots:
    """The configurations at flat positions of the grid (motor_ratio slowest, distance_m fastest)."""
    places = np.unravel_index(index, SHAPE)
    numbers = {axis.name: axis.values()[place] for axis, place in zip(AXES, places, strict=True)}
    return Shots(tuple(f"sim-{position:06d}" for position in index), numbers, {})


def label_grid(rig: Rig, coefficients: Mapping[str, Mapping[str, float]],
               progress: Progress = lambda done, note: None, curves: Curves = NONE,
               among: Catalogue | None = None) -> np.ndarray:
    """Outcome of every configuration of the grid, flat, by the simulator with gravity and these terms.

    Some of the terms may go with curves. among: the catalogue of the terms, truearc.sim.physics.catalogue.catalogue()
    when not given. InputError when the rig has no target, or cannot turn a motor ratio into a launch.
    """
    opening = opening_of(rig, coefficients, among)     # a rig without target: no work
    shots = grid_shots(np.arange(np.prod(SHAPE)))
    flown = predict(rig, coefficients, shots, progress, before_the_shot(curves, rig, shots), among, STEP_S)
    return classify(rig, np.asarray(flown.height_m), opening)


def taken_configurations(shots: Shots) -> np.ndarray:
    """Flat positions of the grid nearest to recorded shots; a shot that lacks one of the three columns has none."""
    known = np.all([np.isfinite(shots.number(axis.name)) for axis in AXES], axis=0)
    places = np.stack([axis.nearest(shots.number(axis.name)[known]) for axis in AXES])
    return np.unique(np.ravel_multi_index(tuple(places[:, (places >= 0).all(axis=0)]), SHAPE))


def sample_balanced(outcomes: np.ndarray, count: int, taken: np.ndarray, seed: int) -> np.ndarray:
    """`count` flat positions, ascending, as evenly by outcome as may be, none of them in `taken`; drawn by seed.

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
    """InputError names the option that no sample can be drawn with."""
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


COLOURS = ("#1f5fa8", "#d99000", "#1b7f3b", "#b3261e", "#6b4fa0", "#9aa3af")


class SweepSetting(NamedTuple):
    """How many simulated shots, and their weight in the loss (the paper's lambda); without any the weight is 0."""

    size: int
    weight: float

    def words(self) -> str:
        return f"{self.size} simulated shots, lambda {self.weight:g}" if self.size else "no simulated shots"


class SweepNetwork(NamedTuple):
    """One network of a sweep before it is trained."""

    setting: SweepSetting
    seed: int
    job: Job
    heldout: Rows


class SweepScore(NamedTuple):
    """What became of one network; losses are mean cross-entropies a shot, accuracies shares of the held-out shots."""

    size: int
    weight: float
    seed: int
    step: int
    validation_loss: float
    heldout_loss: float
    outcome: float
    two: float
    three: float


class Mean(NamedTuple):
    """Mean over seeds and half the width of its 95 % interval by Student's t; the half is NaN for a single seed."""

    value: float
    half: float


class Verdict(NamedTuple):
    """The best setting by validation, and its held-out loss less that of a rival, seed by seed."""

    best: SweepSetting
    rival: SweepSetting
    gain: Mean                        # positive: the best is better


def settings_of(sizes: Sequence[int], weights: Sequence[float]) -> list[SweepSetting]:
    """Every size with every weight; size 0 once. InputError on nonsense."""
    for size in sizes:
        if size < 0:
            raise InputError(f"--sizes: {size} is less than 0")
    for weight in weights:
        if not 0.0 <= weight < math.inf:
            raise InputError(f"--lambdas: {weight} is not 0 or more")
    return list(dict.fromkeys([SweepSetting(size, weight if size else 0.0) for size in sizes for weight in weights]))


def plan(real: Rows, simulated: Rows | None, settings: Sequence[SweepSetting], seeds: Sequence[int], holdout: float,
         validation: float) -> list[SweepNetwork]:
    """Settings x seeds. A seed draws the splits, first weights and which simulated shots; settings share all that.

    So settings can be compared seed by seed; fewer simulated shots are a part of more of them.
    """
    most = max(setting.size for setting in settings)
    there = 0 if simulated is None else len(simulated.features)
    if most > there:
        raise InputError(f"--sizes: {most} simulated shots are asked for and --sim has {there}")
    networks = []
    for seed in seeds:
        kept, heldout = split_heldout(real, holdout, seed)
        learnt, watched = split_heldout(kept, validation, seed, "--validation")
        for name, rows in (("--holdout", heldout), ("--validation", watched)):
            if not len(rows.features):
                raise InputError(f"{name} leaves no shot to judge by ({len(real.features)} recorded shots in all)")
        order = np.zeros(0, int) if simulated is None else balanced_order(simulated, seed)
        for setting in settings:
            part = (None if simulated is None or not setting.size
                    else Rows(*(array[order[:setting.size]] for array in simulated)))
            networks.append(SweepNetwork(setting, seed, Job(learnt, part, watched, setting.weight, seed), heldout))
    return networks


def balanced_order(rows: Rows, seed: int) -> np.ndarray:
    """All rows, drawn by seed, in an order whose every beginning is as evenly mixed by class as it can be."""
    rng = np.random.default_rng([seed, 3])
    level = rows.labels.sum(axis=1)
    turn = np.empty(len(level))
    for value in np.unique(level):
        members = rng.permutation(np.flatnonzero(level == value))
        turn[members] = np.arange(len(members))
    return np.lexsort((level, turn))


def judge(network: SweepNetwork, trained: Trained) -> SweepScore:
    """A trained network against the shots it was not trained on."""
    right = accuracy(trained.network, network.heldout)
    assert network.job.validation is not None
    return SweepScore(*network.setting, network.seed, trained.step, mean_loss(trained.network, network.job.validation),
                 mean_loss(trained.network, network.heldout), right["outcome"], right["two"], right["three"])


def mean_of(values: Sequence[float]) -> Mean:
    """Mean and half its 95 % interval. Seeds share shots, so the interval covers the draw, not another session."""
    numbers = np.asarray(values, float)
    return Mean(float(numbers.mean()), student_half(numbers))


def of_setting(scores: Sequence[SweepScore], setting: SweepSetting) -> list[SweepScore]:
    """The scores of one setting, in the order of their seeds."""
    return sorted((score for score in scores if (score.size, score.weight) == setting), key=lambda score: score.seed)


def compare(scores: Sequence[SweepScore], settings: Sequence[SweepSetting]) -> Verdict | None:
    """The setting with the least mean validation loss against its rival: no simulated shots, or else the next best.

    The held-out shots have no say in which is best. None when there is a single setting.
    """
    ranked = sorted(settings, key=lambda setting: mean_of([score.validation_loss
                                                           for score in of_setting(scores, setting)]).value)
    if len(ranked) < 2:
        return None
    plain = [setting for setting in ranked[1:] if not setting.size]
    rival = plain[0] if plain else ranked[1]
    pairs = zip(of_setting(scores, ranked[0]), of_setting(scores, rival), strict=True)
    return Verdict(ranked[0], rival, mean_of([other.heldout_loss - one.heldout_loss for one, other in pairs]))


def draw_sweep(scores: Sequence[SweepScore], settings: Sequence[SweepSetting]) -> Figure:
    """Held-out cross-entropy and accuracy by amount of simulated data, one line a lambda, 95 % intervals."""
    figure, panels = new_panels(8.0, 5.6, 2, sharex=True)
    weights = sorted({setting.weight for setting in settings if setting.size}) or [0.0]
    for place, weight in enumerate(weights):
        shown = sorted(setting for setting in settings if not setting.size or setting.weight == weight)
        for axes, name in zip(panels, ("heldout_loss", "outcome"), strict=True):
            means = [mean_of([getattr(score, name) for score in of_setting(scores, setting)]) for setting in shown]
            half = np.nan_to_num([mean.half for mean in means])
            axes.errorbar([setting.size for setting in shown], [mean.value for mean in means], half, marker="o",
                          capsize=3, color=COLOURS[place % len(COLOURS)], label=f"lambda {weight:g}")
    panels[0].set_ylabel("cross-entropy, held out")
    panels[1].set(ylabel="outcome right, held out", xlabel="simulated shots")
    panels[0].legend(frameon=False)
    return figure
