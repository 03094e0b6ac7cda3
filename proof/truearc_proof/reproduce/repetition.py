"""One repetition: a draw, the paper's simulator fitted to it, its simulated data, and all models but the networks."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.gate.train import train_physics_gate
from truearc.sim.infer.fit import fit_map
from truearc.sim.paper.grid_fit import fit_grid
from truearc.sim.paper.score import Score, score
from truearc.sim.paper.synthetic_data import grid_shots, label_grid, sample_balanced, taken_configurations
from truearc.sim.paper.training import LABELS, Rows, training_rows
from truearc.sim.physics.simulate import classify, predict
from truearc_proof.reproduce.baselines import fit_baselines
from truearc_proof.reproduce.collect import Pool
from truearc_proof.reproduce.draws import Draw, draw
from truearc_proof.reproduce.settings import Settings

SIMULATOR, OURS = "simulator alone", "our gate"
# Terms that the gate's physics may hold: the paper's forces, and a loss of speed between wheels and ball.
OUR_TERMS = ("gravity", "drag", "magnus", "exit_efficiency", "wheel_slip")


class Task(NamedTuple):
    """What one repetition needs; travels to whatever process or machine runs it."""

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
    all_train = _rows(train)
    seed = settings.base_seed + task.number
    predictions = {SIMULATOR: _labels(np.concatenate([_outcomes(rig, fit.coefficients, shots)
                                                      for shots in (test, transfer)]))}
    predictions |= {name: fitted(asked.features) for name, fitted in fit_baselines(all_train, seed).items()}
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
    """D_s of every size asked for, each an even draw of its own from the grid, none at a configuration of `train`."""
    outcomes = label_grid(rig, coefficients)
    taken = taken_configurations(train)
    sets = {}
    for size in sorted({*settings.sizes, settings.best_size} - {0}):
        index = sample_balanced(outcomes, size, taken, 10_000 * seed + size)
        shots = grid_shots(index)
        sets[size] = _rows(Shots(shots.shot_id, shots.numbers, {"outcome": tuple(map(str, outcomes[index]))}))
    return sets


def our_predictions(rig: Rig, train: Shots, asked: Rows, seed: int) -> dict[str, np.ndarray]:
    """Our gate's, from the same configurations and labels as everybody else's, and nothing besides."""
    split = Dataset("training split", rig, train)
    belief = fit_map(split, OUR_TERMS).belief
    return {OURS: train_physics_gate(rig, belief, train, seed, "training split")[0].probabilities(asked.features)}


def _outcomes(rig: Rig, coefficients: dict[str, dict[str, float]], shots: Shots) -> np.ndarray:
    return classify(rig, predict(rig, coefficients, shots).height_m)


def _labels(outcomes: np.ndarray) -> np.ndarray:
    return np.array([LABELS[outcome] for outcome in outcomes], float)


def _rows(*shots: Shots) -> Rows:
    """Their rows, one set after the other; none may lack a feature or an outcome."""
    parts = [training_rows(part, "pool") for part in shots]
    assert not any(left_out for _, left_out in parts)
    return Rows(*(np.concatenate(columns) for columns in zip(*(rows for rows, _ in parts), strict=True)))
