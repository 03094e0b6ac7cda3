"""How well a set of coefficients explains recorded outcomes, in the paper's measures (section IV-C, Table I)."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool

from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.dataset import Shots
from truearc.sim.physics.simulate import MISS, THREE, TWO, classify, opening_of, predict


class Score(NamedTuple):
    """Shares in 0-1, nan where no shot counts; deviations in m of the shots whose outcome is three.

    `three`: of shots with outcome three, those flown into the three. `two`: of shots with outcome two or three, those
    flown into the two. `all`: of all shots with an outcome, those whose outcome is predicted exactly.
    """

    three: float
    two: float
    all: float
    mean_m: float
    median_m: float
    shots: int


def score(rig: Rig, coefficients: Mapping[str, Mapping[str, float]], shots: Shots) -> Score:
    """Predict every shot that has an outcome and compare; a plane not reached is an infinite deviation."""
    known = shots.take(np.flatnonzero(np.isin(shots.text("outcome"), (MISS, TWO, THREE))))
    outcome = np.array(known.text("outcome"), dtype=str)
    height_m = predict(rig, coefficients, known).height_m
    opening = opening_of(rig, coefficients)
    said = classify(rig, height_m, opening)
    is_three = outcome == THREE
    deviation_m = np.nan_to_num(np.abs(height_m - opening.centre_m), nan=np.inf)[is_three]
    return Score(_share((said == THREE)[is_three]), _share((said != MISS)[outcome != MISS]), _share(said == outcome),
                 float(np.mean(deviation_m)) if is_three.any() else np.nan,
                 float(np.median(deviation_m)) if is_three.any() else np.nan, len(known))


def _share(hits: Bool[np.ndarray, " n"]) -> float:
    return float(np.mean(hits)) if hits.size else float("nan")
