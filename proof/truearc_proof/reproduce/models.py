"""The models of a repetition: the paper's simulator and networks, and truearc's gate.

The simulator is fitted to the repetition's draw. Every model classifies shots as a miss, two or three, and returns the
two probabilities that a gate returns: p_two = P(two or three), p_three = P(three).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from truearc.robot.config.rig_spec import Rig
from truearc.sim import statistics as figures
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.gate.train import train_physics_gate
from truearc.sim.infer.launcher import fit_map
from truearc.sim.paper import Recipe
from truearc.sim.paper.grid_fit import Score, fit_grid, score
from truearc.sim.paper.network import LABELS, Rows, probabilities, training_rows
from truearc.sim.paper.sweep import SweepSetting
from truearc.sim.paper.synthetic import grid_shots, label_grid, sample_balanced, taken_configurations
from truearc.sim.paper.train_many import Job, train_many
from truearc.sim.physics.simulate import classify, predict
from truearc.sim.printed import Progress
from truearc.sim.statistics import student_half
from truearc_proof.reproduce import EVERYTHING, REAL, SIMULATED, WHERE, Settings
from truearc_proof.reproduce.collect import Draw, Pool, draw

SIMULATOR, OURS = "simulator alone", "our gate"
# Terms that the gate's physics may hold: the paper's forces, and a loss of speed between wheels and ball.
OUR_TERMS = ("gravity", "drag", "magnus", "exit_efficiency", "wheel_slip")


class Task(NamedTuple):
    """What one repetition needs; it can be sent to any process or machine."""

    real: Shots
    launched: Shots
    facts: Rig
    settings: Settings
    number: int


@dataclass(frozen=True)
class Repetition:
    """Its rows are the draw's: `test` 20 configurations and `transfer` 50, which are predicted together, in order.

    `scores`: Table I. `deviation_m`: of the simulator's flight from the target's centre for each test configuration,
    infinite where it does not reach the plane, with `outcome` what happened. `predictions`: name -> p [70, 2].
    """

    number: int
    draw: Draw
    learn: Rows                       # train less validation
    validation: Rows
    asked: Rows                       # test, then transfer
    tests: int                        # number of rows of `asked` that are the test
    coefficients: dict[str, dict[str, float]]
    tied: int                         # coefficient pairs that were equally good
    scores: dict[str, Score]
    deviation_m: np.ndarray
    outcome: tuple[str, ...]
    simulated: dict[int, Rows]        # size of D_s -> its rows
    predictions: dict[str, np.ndarray]


def tasks_of(pool: Pool, settings: Settings) -> list[Task]:
    return [Task(pool.real.shots, pool.launched.shots, pool.real.facts, settings, number)
            for number in range(settings.draws)]


def run_repetition(task: Task) -> Repetition:
    """Fit and predict all but the networks, which are trained together afterwards; pure."""
    settings, rig = task.settings, task.facts
    drawn = draw(task.real, task.launched, settings, task.number)
    train, test, transfer = (task.real.take(drawn.train), task.real.take(drawn.test),
                             task.launched.take(drawn.transfer))
    fit = fit_grid(rig, train, settings.grid_step)
    scores = {"Training": score(rig, fit.coefficients, train), "Testing": score(rig, fit.coefficients, test)}
    asked = _rows(test, transfer)
    seed = settings.base_seed + task.number
    said = [classify(rig, predict(rig, fit.coefficients, shots).height_m) for shots in (test, transfer)]
    predictions = {SIMULATOR: np.array([LABELS[outcome] for outcome in np.concatenate(said)], float)}
    predictions |= our_predictions(rig, train, asked, seed)
    height_m = predict(rig, fit.coefficients, test).height_m
    assert rig.target is not None
    return Repetition(
        task.number, drawn, _rows(task.real.take(np.setdiff1d(drawn.train, drawn.validation))),
        _rows(task.real.take(drawn.validation)), asked, len(test), fit.coefficients, int(fit.tied.sum()), scores,
        np.nan_to_num(np.abs(height_m - rig.target.centre_height_m), nan=np.inf), test.text("outcome"),
        simulated_sets(rig, fit.coefficients, train, settings, seed), predictions)


def simulated_sets(rig: Rig, coefficients: dict[str, dict[str, float]], train: Shots, settings: Settings,
                   seed: int) -> dict[int, Rows]:
    """Return D_s of every requested size, each drawn evenly and separately from the grid, without configurations of
    `train`."""
    outcomes = label_grid(rig, coefficients)
    taken = taken_configurations(train)
    sets = {}
    for size in sorted({*settings.sizes, settings.best_size} - {0}):
        index = sample_balanced(outcomes, size, taken, 10_000 * seed + size)
        shots = grid_shots(index)
        sets[size] = _rows(Shots(shots.shot_id, shots.numbers, {"outcome": tuple(map(str, outcomes[index]))}))
    return sets


def our_predictions(rig: Rig, train: Shots, asked: Rows, seed: int) -> dict[str, np.ndarray]:
    """Return our gate's predictions, from the same configurations and labels as all others use, and nothing else."""
    split = Dataset("training split", rig, train)
    belief = fit_map(split, OUR_TERMS).belief
    return {OURS: train_physics_gate(rig, belief, train, seed, "training split")[0].probabilities(asked.features)}


def _rows(*shots: Shots) -> Rows:
    """Their rows, one set after the other; none may lack a feature or an outcome."""
    parts = [training_rows(part, "pool") for part in shots]
    assert not any(left_out for _, left_out in parts)
    return Rows(*(np.concatenate(columns) for columns in zip(*(rows for rows, _ in parts), strict=True)))


class Answer(NamedTuple):
    """One network's p [70, 2] on the test rows, its lowest validation loss and the epoch of that loss."""

    p: np.ndarray
    validation_loss: float
    epoch: int


def settings_of(settings: Settings) -> list[SweepSetting]:
    """Return the settings of Table II and Figure 10, each once."""
    return list(dict.fromkeys([*(SweepSetting(size, settings.best_weight) for size in settings.sizes),
                               *(SweepSetting(settings.best_size, weight) for weight in settings.weights)]))


def train_networks(repetitions: Sequence[Repetition], settings: Settings,
                   progress: Progress) -> list[dict[SweepSetting, Answer]]:
    """Return one answer per setting, repetition by repetition; initial weights and minibatches depend on the
    repetition."""
    wanted = settings_of(settings)
    jobs = [Job(one.learn, one.simulated.get(setting.size), one.validation, setting.weight,
                1000 * settings.base_seed + one.number) for one in repetitions for setting in wanted]
    trained = iter(train_many(jobs, Recipe(steps=settings.steps, patience=settings.patience), progress))
    answers = []
    for one in repetitions:
        named = {}
        for setting in wanted:
            network = next(trained)
            loss = min(point.validation for point in network.curve)
            named[setting] = Answer(probabilities(network.network, one.asked.features), loss, network.epoch)
        answers.append(named)
    return answers


# --- metrics of every model, the best settings, paired differences

CUT = 0.5
CLASSES = {"miss": (False, False), "two": (True, False), "three": (True, True)}
BY_VALIDATION = "seed's network, setting best by validation"
BY_TEST = "seed's network, setting best by test (generous)"
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
    """Compute all metrics of predictions p [n, 2] with labels [n, 2] of 0 and 1.

    A row labelled three but not two has no outcome and is wrong.
    """
    said, was = p >= CUT, labels >= 0.5
    three, two = (_of_class(said, was, outcome) for outcome in ("three", "two"))
    brier, ece = ((float(np.mean((p - labels)**2)), figures.calibration_error(p.ravel(), labels.ravel())) if len(p)
                  else (float("nan"), float("nan")))
    return Metrics(figures.accuracy(p, was), three[0], two[0], three[1], two[1], brier, ece)


def _of_class(said: np.ndarray, was: np.ndarray, outcome: str) -> tuple[float, float]:
    """(share of that outcome called so, F1); F1 is 0 where it is never called rightly, NaN where there is none."""
    called = (said == np.array(CLASSES[outcome])).all(axis=1)
    there = (was == np.array(CLASSES[outcome])).all(axis=1)
    return float(np.mean(called[there])) if there.any() else float("nan"), figures.f1(called, there)


class Interval(NamedTuple):
    """A mean over repetitions with its 95 % interval by Student's t."""

    mean: float
    low: float
    high: float


def interval(values: np.ndarray) -> Interval:
    """Return the interval of one value per repetition; NaN rows are omitted, and fewer than two leave the bounds NaN.

    For a paired comparison pass the differences. Repetitions that draw from one pool overlap, so the interval covers
    new draws from these recordings; one that covered new recordings would be wider.
    """
    mean, kept = _mean(values), values[~np.isnan(values)]
    half = student_half(kept) if len(kept) > 1 else float("nan")
    return Interval(mean, mean - half, mean + half)


class Figure(NamedTuple):
    """Metrics of one model on one set of rows in one repetition; size and weight are None unless it is a network."""

    repetition: int
    model: str
    size: int | None
    weight: float | None
    where: str
    metrics: Metrics


class Difference(NamedTuple):
    """Ours minus the other's, paired by repetition; `better`: the whole interval is on the better side of 0."""

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
    """All figures, and the results derived from them."""

    figures: tuple[Figure, ...]
    differences: tuple[Difference, ...]

    def values(self, model: str, where: str, metric: str) -> np.ndarray:
        """Return one value per repetition, in order; empty if there is no such model."""
        return np.array([getattr(figure.metrics, metric) for figure in self.figures
                         if figure.model == model and figure.where == where])

    def models(self) -> list[str]:
        """Names of all models except the networks' settings, in order of appearance."""
        return list(dict.fromkeys(figure.model for figure in self.figures if not figure.model.startswith(NETWORK)))


NETWORK = "network at "


def network_name(setting: SweepSetting) -> str:
    return f"{NETWORK}{setting.size} simulated, lambda {setting.weight:g}"


def analyse(repetitions: Sequence[Repetition], answers: Sequence[dict[SweepSetting, Answer]]) -> Analysis:
    """Return the figures of every model in every repetition, and ours against all others."""
    figures: list[Figure] = []
    for one, networks in zip(repetitions, answers, strict=True):
        for name, p in one.predictions.items():
            figures += _figures(one, name, None, p)
        for setting, answer in networks.items():
            figures += _figures(one, network_name(setting), setting, answer.p)
        least = min(networks, key=lambda setting: networks[setting].validation_loss)
        figures += _figures(one, BY_VALIDATION, least, networks[least].p)
    bare = Analysis(tuple(figures), ())
    return Analysis(bare.figures, tuple(_differences(bare, list(answers[0]))))


def _figures(one: Repetition, model: str, setting: SweepSetting | None, p: np.ndarray) -> list[Figure]:
    size, weight = (None, None) if setting is None else setting
    parts = {EVERYTHING: slice(None), REAL: slice(0, one.tests), SIMULATED: slice(one.tests, None)}
    return [Figure(one.number, model, size, weight, where, measure(p[part], one.asked.labels[part]))
            for where, part in parts.items()]


def _differences(analysis: Analysis, settings: list[SweepSetting]) -> list[Difference]:
    found = []
    for where, metric in product(WHERE, COMPARED):
        best = best_by_test(analysis, settings, where, metric)
        others = [(other, other, "") for other in analysis.models() if other != OURS]
        for model, other, setting in (*others, (network_name(best), BY_TEST,
                                                f"{best.size} simulated, lambda {best.weight:g}")):
            ours, theirs = analysis.values(OURS, where, metric), analysis.values(model, where, metric)
            gap = interval(ours - theirs)
            better = gap.high < 0.0 if metric in LOW_IS_GOOD else gap.low > 0.0
            found.append(Difference(where, metric, other, setting, _mean(ours), _mean(theirs), gap, better))
    return found


def best_by_test(analysis: Analysis, settings: list[SweepSetting], where: str, metric: str) -> SweepSetting:
    """Return the setting with the best mean over repetitions on the very rows that judge it."""
    sign = -1.0 if metric in LOW_IS_GOOD else 1.0
    means = {setting: _mean(analysis.values(network_name(setting), where, metric)) for setting in settings}
    return max(settings, key=lambda setting: -np.inf if np.isnan(means[setting]) else sign * means[setting])


def _mean(values: np.ndarray) -> float:
    """Over the repetitions that have a value; NaN when none has."""
    kept = values[~np.isnan(values)]
    return float(kept.mean()) if len(kept) else float("nan")
