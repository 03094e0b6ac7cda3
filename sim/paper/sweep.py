"""A sweep of training runs over the amounts and weights of simulated data, and its results."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from truearc.errors import InputError
from truearc.sim.paper.network import Rows, accuracy, mean_loss, split_heldout
from truearc.sim.paper.train_many import Job, Trained
from truearc.sim.report import new_panels
from truearc.sim.statistics import student_half

COLOURS = ("#1f5fa8", "#d99000", "#1b7f3b", "#b3261e", "#6b4fa0", "#9aa3af")


class SweepSetting(NamedTuple):
    """Number of simulated shots, and their weight in the loss (the paper's lambda); without any the weight is 0."""

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
    """Result of one network; losses are mean cross-entropies per shot, accuracies shares of the held-out shots."""

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
    """The best setting by validation, and its held-out loss minus that of a rival, seed by seed."""

    best: SweepSetting
    rival: SweepSetting
    gain: Mean                        # positive: the best is better


def settings_of(sizes: Sequence[int], weights: Sequence[float]) -> list[SweepSetting]:
    """Return every size with every weight; size 0 once. InputError for invalid values."""
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
    """Return all rows, drawn by seed, in an order whose every prefix is as balanced by class as possible."""
    rng = np.random.default_rng([seed, 3])
    level = rows.labels.sum(axis=1)
    turn = np.empty(len(level))
    for value in np.unique(level):
        members = rng.permutation(np.flatnonzero(level == value))
        turn[members] = np.arange(len(members))
    return np.lexsort((level, turn))


def judge(network: SweepNetwork, trained: Trained) -> SweepScore:
    """Evaluate a trained network on the shots that it was not trained on."""
    right = accuracy(trained.network, network.heldout)
    assert network.job.validation is not None
    return SweepScore(*network.setting, network.seed, trained.step, mean_loss(trained.network, network.job.validation),
                 mean_loss(trained.network, network.heldout), right["outcome"], right["two"], right["three"])


def mean_of(values: Sequence[float]) -> Mean:
    """Return the mean and half its 95 % interval. Seeds share shots, so the interval covers the draw, not another
    session."""
    numbers = np.asarray(values, float)
    return Mean(float(numbers.mean()), student_half(numbers))


def of_setting(scores: Sequence[SweepScore], setting: SweepSetting) -> list[SweepScore]:
    """Return the scores of one setting, in the order of their seeds."""
    return sorted((score for score in scores if (score.size, score.weight) == setting), key=lambda score: score.seed)


def compare(scores: Sequence[SweepScore], settings: Sequence[SweepSetting]) -> Verdict | None:
    """Compare the setting with the lowest mean validation loss with its rival: no simulated shots, or else the next
    best.

    Held-out shots do not affect the choice. None with a single setting.
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
    """Draw held-out cross-entropy and accuracy over the number of simulated shots, one line per lambda, 95 %
    intervals."""
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
