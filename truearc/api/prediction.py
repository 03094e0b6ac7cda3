"""Forecast recorded or planned shots."""

from pathlib import Path
from typing import Any

from truearc.api.table import Table
from truearc.model_export.predict import HEADER as RATING_COLUMNS
from truearc.model_export.predict import rate_shots
from truearc.robot.config.schema import InputError
from truearc.robot.gate.model import load_gate
from truearc.sim.data.dataset import Dataset
from truearc.sim.discover.predictions import predict_shots
from truearc.sim.infer.belief import Belief
from truearc.sim.progress import Progress

COLUMNS = ("shot_id", "height_m", "deviation_m", "outcome")


def predict(dataset: Dataset, belief: Belief | None = None, *, gate: str | Path | None = None,
            progress: Progress = lambda done, note: None) -> Table:
    """Forecast each shot of a dataset, by a belief or by an exported gate.

    Args:
        dataset: Shots with distance_m [m], hood_deg [deg] and motor_ratio [1] (or wheel speeds, for a belief).
        belief: Coefficients to fly the shots with.
        gate: ONNX file of a gate, instead of a belief.
        progress: Called with the share done, 0 to 1, and a note.

    Returns:
        A row per shot. By a belief: shot_id, height_m at the target plane above the floor [m], deviation_m from the
        target's centre [m, up positive], outcome; the heights are None where the ball meets the floor or turns back
        first. By a gate: shot_id, p_two and p_three (probabilities), in_domain, novelty (over 1: further than that
        from all recorded shots); None where the gate gives no number.

    Raises:
        InputError: neither or both of belief and gate, a file that is not a gate, or a column that is missing.
    """
    if (belief is None) == (gate is None):
        raise InputError("predict: give either a belief or gate=FILE")
    if belief is not None:
        told = predict_shots(dataset, belief, progress)
        return _table(COLUMNS, told.shot_id, told.height_m.tolist(), told.deviation_m.tolist(), told.outcome)
    return Table(RATING_COLUMNS, tuple(rate_shots(load_gate(str(gate)), dataset.shots, dataset.name)))


def _table(names: tuple[str, ...], *columns: Any) -> Table:
    return Table(names, tuple(tuple(None if cell != cell else cell for cell in row)
                              for row in zip(*columns, strict=True)))
