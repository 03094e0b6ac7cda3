"""Forecast of each shot of a dataset by a belief: height at the target plane and outcome."""

from dataclasses import dataclass

import numpy as np

from truearc.robot.config.schema import InputError
from truearc.sim.data.dataset import Dataset
from truearc.sim.data.shot_conditions import circumstances_of
from truearc.sim.discover.detect.covariates import every_column
from truearc.sim.infer.belief import Belief
from truearc.sim.infer.curve import along
from truearc.sim.physics.catalogue import effective
from truearc.sim.physics.simulate import classify, opening_of, predict
from truearc.sim.progress import Progress


@dataclass(frozen=True, eq=False)
class ShotPredictions:
    """One row per shot [n].

    `height_m`: height above the floor at the first crossing of x = distance; NaN where the ball meets the floor or
    turns back first. `deviation_m`: that minus the target's centre, up positive. `outcome`: miss, two or three.
    """

    shot_id: tuple[str, ...]
    height_m: np.ndarray
    deviation_m: np.ndarray
    outcome: tuple[str, ...]


def predict_shots(dataset: Dataset, belief: Belief,
                  progress: Progress = lambda done, note: None) -> ShotPredictions:
    """Fly each shot with the belief's coefficients under the conditions that the dataset records.

    Raises:
        InputError: the rig has no target, or a shot lacks what a launch needs.
    """
    if dataset.facts.target is None:
        raise InputError("rig.toml: [target] is needed to tell deviation and outcome")
    circumstances = along(belief.curves, circumstances_of(dataset), every_column(dataset), len(dataset.shots))
    among = belief.catalogue
    opening = opening_of(dataset.facts, effective(belief.coefficients, circumstances, among), among)
    flown = predict(dataset.facts, belief.coefficients, dataset.shots, progress, circumstances, among)
    height_m = np.asarray(flown.height_m)
    outcome = classify(dataset.facts, height_m, opening)
    return ShotPredictions(dataset.shots.shot_id, height_m, np.asarray(height_m - opening.centre_m),
                           tuple(map(str, outcome)))
