"""Repetitions and networks' answers to figures: every model's metrics, the best settings, paired differences."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from truearc.sim import statistics as figures
from truearc.sim.paper.sweep import SweepSetting
from truearc.sim.statistics import student_half
from truearc_proof.reproduce.models import OURS, Answer, Repetition
from truearc_proof.reproduce.settings import EVERYTHING, REAL, SIMULATED, WHERE, Settings

CUT = 0.5
CLASSES = {"miss": (False, False), "two": (True, False), "three": (True, True)}
RESAMPLES = 4000
BY_VALIDATION = "seed's network, setting best by validation"
BY_TEST = "seed's network, setting best by test (generous)"
PAPERS = "seed's network, the paper's setting"
NO_SIMULATED = "network without simulated data"
COMPARED = ("accuracy", "f1_three", "brier", "ece")
LOW_IS_GOOD = ("brier", "ece")


class Metrics(NamedTuple):
    """Shares in 0-1, NaN where there is nothing to share.

    `accuracy`: rows whose outcome (of three) is called right. `class_three`, `class_two`: of the rows of that outcome,
    those called right, which is what the paper's "F1" is. `f1_three`, `f1_two`: F1 proper of that outcome against the
    others. `brier`: mean squared error of the probabilities, over rows and both outputs. `ece`: calibration error
    expected over truearc.sim.statistics.BINS equal bins of both outputs' probabilities, that is the mean over
    predictions of |share of hits - mean probability| of their bin.
    """

    accuracy: float
    class_three: float
    class_two: float
    f1_three: float
    f1_two: float
    brier: float
    ece: float


def measure(p: np.ndarray, labels: np.ndarray) -> Metrics:
    """All metrics of predictions p [n, 2] with labels [n, 2] of 0 and 1.

    A row called three but not two has no outcome and is wrong.
    """
    said, was = p >= CUT, labels >= 0.5
    three, two = (_of_class(said, was, outcome) for outcome in ("three", "two"))
    return Metrics(figures.accuracy(p, was), three[0], two[0], three[1], two[1],
                   float(np.mean((p - labels)**2)) if len(p) else float("nan"), calibration_error(p, labels))


def _of_class(said: np.ndarray, was: np.ndarray, outcome: str) -> tuple[float, float]:
    """(share of that outcome called so, F1); F1 is 0 where it is never called rightly, NaN where there is none."""
    called = (said == np.array(CLASSES[outcome])).all(axis=1)
    there = (was == np.array(CLASSES[outcome])).all(axis=1)
    return _share(called[there]), figures.f1(called, there)


def calibration_error(p: np.ndarray, labels: np.ndarray) -> float:
    """Expected calibration error of truearc.sim.statistics, both outputs together; NaN of nothing."""
    return figures.calibration_error(p.ravel(), labels.ravel()) if len(p) else float("nan")


def _share(right: np.ndarray) -> float:
    return float(np.mean(right)) if right.size else float("nan")


class Interval(NamedTuple):
    """A mean with its 95 % interval by Student's t and by the bootstrap (percentiles), over `n` repetitions."""

    mean: float
    low: float
    high: float
    boot_low: float
    boot_high: float
    n: int


def interval(values: np.ndarray, seed: int = 0) -> Interval:
    """Of one value a repetition; NaN rows are left out, and fewer than two leave the bounds NaN.

    For a paired comparison pass the differences. Repetitions that draw from one pool overlap, so the interval covers
    new draws from these recordings; one that covered new recordings would be wider.
    """
    kept = np.asarray(values, float)[~np.isnan(np.asarray(values, float))]
    if len(kept) < 2:
        mean = float(kept[0]) if len(kept) else float("nan")
        nan = float("nan")
        return Interval(mean, nan, nan, nan, nan, len(kept))
    mean = float(kept.mean())
    half = student_half(kept)
    draws = np.random.default_rng([seed, 35]).integers(0, len(kept), (RESAMPLES, len(kept)))
    boot_low, boot_high = np.percentile(kept[draws].mean(axis=1), [2.5, 97.5])
    return Interval(mean, mean - half, mean + half, float(boot_low), float(boot_high), len(kept))


class Figure(NamedTuple):
    """Metrics of one model on one set of rows in one repetition; size and weight are None unless it is a network."""

    repetition: int
    model: str
    size: int | None
    weight: float | None
    where: str
    metrics: Metrics


class Difference(NamedTuple):
    """Ours minus the other's, paired by repetition; `better`: the whole interval is on the good side of 0."""

    where: str
    metric: str
    other: str
    setting: str
    ours: float
    theirs: float
    difference: Interval
    better: bool


@dataclass(frozen=True)
class Analysis:
    """All figures, and what follows from them."""

    figures: tuple[Figure, ...]
    differences: tuple[Difference, ...]

    def values(self, model: str, where: str, metric: str) -> np.ndarray:
        """One value a repetition, in order; empty when there is no such model."""
        return np.array([getattr(figure.metrics, metric) for figure in self.figures
                         if figure.model == model and figure.where == where])

    def models(self) -> list[str]:
        """Names of all models, the networks' settings apart, in the order in which they came."""
        return list(dict.fromkeys(figure.model for figure in self.figures if not figure.model.startswith(NETWORK)))


NETWORK = "network at "


def network_name(setting: SweepSetting) -> str:
    return f"{NETWORK}{setting.size} simulated, lambda {setting.weight:g}"


def analyse(repetitions: Sequence[Repetition], answers: Sequence[dict[SweepSetting, Answer]],
            settings: Settings) -> Analysis:
    """Figures of every model in every repetition, and ours against all others where there is ours."""
    figures: list[Figure] = []
    for one, networks in zip(repetitions, answers, strict=True):
        for name, p in one.predictions.items():
            figures += _figures(one, name, None, p)
        for setting, answer in networks.items():
            figures += _figures(one, network_name(setting), setting, answer.p)
        least = min(networks, key=lambda setting: networks[setting].validation_loss)
        paper = SweepSetting(settings.best_size, settings.best_weight)
        figures += _figures(one, BY_VALIDATION, least, networks[least].p)
        figures += _figures(one, PAPERS, paper, networks[paper].p)
        if (none := SweepSetting(0, settings.best_weight)) in networks:
            figures += _figures(one, NO_SIMULATED, none, networks[none].p)
    bare = Analysis(tuple(figures), ())
    return Analysis(bare.figures, tuple(_differences(bare, list(answers[0]))))


def _figures(one: Repetition, model: str, setting: SweepSetting | None, p: np.ndarray) -> list[Figure]:
    size, weight = (None, None) if setting is None else setting
    parts = {EVERYTHING: slice(None), REAL: slice(0, one.tests), SIMULATED: slice(one.tests, None)}
    return [Figure(one.number, model, size, weight, where, measure(p[part], one.asked.labels[part]))
            for where, part in parts.items()]


def _differences(analysis: Analysis, settings: list[SweepSetting]) -> list[Difference]:
    found = []
    if OURS not in analysis.models():
        return []
    for where in WHERE:
        for metric in COMPARED:
            best = best_by_test(analysis, settings, where, metric)
            for other in analysis.models():
                if other != OURS:
                    found.append(_difference(analysis, where, metric, other, other, ""))
            found.append(_difference(analysis, where, metric, network_name(best), BY_TEST,
                                     f"{best.size} simulated, lambda {best.weight:g}"))
    return found


def best_by_test(analysis: Analysis, settings: list[SweepSetting], where: str, metric: str) -> SweepSetting:
    """The one setting with the best mean over repetitions on the very rows that it is judged by."""
    sign = -1.0 if metric in LOW_IS_GOOD else 1.0
    means = {setting: _mean(analysis.values(network_name(setting), where, metric)) for setting in settings}
    return max(settings, key=lambda setting: -np.inf if np.isnan(means[setting]) else sign * means[setting])


def _mean(values: np.ndarray) -> float:
    """Over the repetitions that have a value; NaN when none has."""
    kept = values[~np.isnan(values)]
    return float(kept.mean()) if len(kept) else float("nan")


def _difference(analysis: Analysis, where: str, metric: str, model: str, other: str, setting: str) -> Difference:
    ours, theirs = analysis.values(OURS, where, metric), analysis.values(model, where, metric)
    gap = interval(ours - theirs)
    better = max(gap.high, gap.boot_high) < 0.0 if metric in LOW_IS_GOOD else min(gap.low, gap.boot_low) > 0.0
    return Difference(where, metric, other, setting, _mean(ours), _mean(theirs), gap, better)
