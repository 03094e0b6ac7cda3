"""Forecast recorded or planned shots."""

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from truearc.api.table import Table
from truearc.api.terms import check_kind
from truearc.errors import InputError
from truearc.model_export.verify import HEADER as RATING_COLUMNS
from truearc.model_export.verify import rate_shots
from truearc.robot.gate.model import load_gate
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.data.shot_conditions import circumstances_of
from truearc.sim.infer.belief import Belief, along
from truearc.sim.infer.likelihood.data import every_column
from truearc.sim.infer.plausibility.check import check_plausible
from truearc.sim.physics.simulate import classify, opening_of
from truearc.sim.physics.simulate import predict as fly_shots
from truearc.sim.progress import Progress

ROUNDING = 1e-6                       # of a fitted range: a converted unit is not outside it
COLUMNS = ("shot_id", "height_m", "deviation_m", "outcome", "note")
NOT_REACHED = "does not reach the target: it meets the floor or turns back first"


def predict(dataset: Dataset, belief: Belief | None = None, *, gate: str | Path | None = None,
            accept: Collection[str] = (), progress: Progress = lambda done, note: None) -> Table:
    """Forecast each shot of a dataset, by a belief or by an exported gate.

    Args:
        dataset: Shots with distance_m [m], hood_deg [deg] and motor_ratio [1] (or wheel speeds, for a belief).
        belief: Coefficients to fly the shots with.
        gate: ONNX file of a gate, instead of a belief.
        accept: Names of plausibility checks whose objections are accepted.
        progress: Called with the share done, 0 to 1, and a note.

    Returns:
        A row per shot. By a belief: shot_id, height_m at the target plane above the floor [m], deviation_m from the
        target's centre [m, up positive], outcome, and a note on a setting outside the range of the shots that the
        belief was fitted to, on a rig other than theirs, or on why there is no height (None: the ball meets the floor
        or turns back first). By a gate: shot_id, p_two and p_three (probabilities), in_domain, novelty (over 1: further
        than that from all recorded shots); None where the gate gives no number.

    Raises:
        InputError: implausible data, neither or both of belief and gate, a file that is not a gate, a column that is
            missing, or a rig without a target.
    """
    check_kind("dataset", dataset, Dataset, "load_dataset(...)")
    if (belief is None) == (gate is None):
        raise InputError("predict: give either a belief or gate=FILE")
    dataset = check_plausible(dataset, accept)
    if belief is None:
        return Table(RATING_COLUMNS, tuple(rate_shots(load_gate(str(gate)), dataset.shots, dataset.name)))
    check_kind("belief", belief, Belief, "load_belief(...)")
    flown = _flown(dataset, belief, progress)
    other = belief.other_rig(dataset.rig)
    notes = ["; ".join(filter(None, (note, other))) for note in _notes(dataset.shots, flown[0], belief.provenance)]
    rows = zip(dataset.shots.shot_id, *flown, notes, strict=True)
    return Table(COLUMNS, tuple(tuple(None if cell != cell else cell for cell in row) for row in rows))


def _notes(shots: Shots, height_m: list[float], provenance: Mapping[str, Any]) -> list[str]:
    """What to know of each forecast; "" where there is nothing."""
    notes: list[list[str]] = [[NOT_REACHED] if height != height else [] for height in height_m]
    fitted = provenance.get("range", {})
    for name, (low, high) in fitted.items() if isinstance(fitted, Mapping) else ():
        room = ROUNDING * (high - low)
        for note, value in zip(notes, shots.number(name).tolist(), strict=True):
            if value < low - room or value > high + room:
                note.append(f"{name} {value:.4g} is outside the fitted {low:.4g} to {high:.4g}")
    return ["; ".join(note) for note in notes]


def _flown(dataset: Dataset, belief: Belief, progress: Progress) -> tuple[list[float], list[float], list[str]]:
    """Height, deviation and outcome of each shot, under the conditions that the dataset records; NaN: not reached."""
    if dataset.rig.target is None:
        raise InputError("rig.toml: target.centre_height_m: missing key; state the opening in [target]"
                         ": deviation and outcome are about it")
    circumstances = along(belief.curves, circumstances_of(dataset), every_column(dataset), len(dataset.shots))
    among = belief.catalogue
    opening = opening_of(dataset.rig, belief.coefficients, among, circumstances)
    flown = fly_shots(dataset.rig, belief.coefficients, dataset.shots, progress, circumstances, among)
    height_m = np.asarray(flown.height_m)
    return (height_m.tolist(), np.asarray(height_m - opening.centre_m).tolist(),
            classify(dataset.rig, height_m, opening).tolist())
