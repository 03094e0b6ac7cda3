"""Train a gate, the classifier that decides from the robot's readings whether a shot is likely to score."""

import tempfile
from collections.abc import Collection
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from truearc.api.arguments import check_kind
from truearc.errors import InputError
from truearc.model_export.graph import export_weights
from truearc.robot.gate import facing_up_of, load_gate
from truearc.sim.check.check import check_plausible
from truearc.sim.data.dataset import Dataset
from truearc.sim.data.files import hash_dataset
from truearc.sim.gate import train
from truearc.sim.gate.model import PhysicsGate, physics_of, save_physics_gate
from truearc.sim.infer.belief import Belief
from truearc.sim.paper.network import domain_of
from truearc.sim.printed import Printed, Progress, show_progress
from truearc.sim.report import draw_reliability
from truearc.sim.statistics import Figures


@dataclass(frozen=True, eq=False)
class GateTraining(Printed):
    """A trained gate and its scores on hold-out configurations.

    `gate`: probabilities as a function of features. `folds`: hold-out shots with their probabilities; None with too few
    configurations. `left_out`: unusable shots, with the reason.
    """

    gate: PhysicsGate
    folds: train.Heldout | None
    left_out: tuple[str, ...]
    marks: train.OutcomeClasses
    record: dict[str, Any]

    @property
    def holdout(self) -> Figures | None:
        """Brier score, accuracy, log score and calibration error on hold-out shots; None with under 15
        configurations."""
        return None if self.folds is None else self.folds.calibrated

    def save(self, directory: str | Path) -> None:
        """Write the weights as a directory for `truearc export` and `truearc verify`.

        Raises:
            InputError: the directory cannot be written.
        """
        save_physics_gate(directory, self.gate, self.record)

    def export(self, path: str | Path) -> str:
        """Write the gate as an ONNX file for the robot and return its SHA-256.

        The file is read back as the robot reads it.

        Raises:
            InputError: the file cannot be written, or the graph differs too much from the gate.
        """
        with tempfile.TemporaryDirectory(prefix="truearc-gate-") as folder:
            self.save(folder)
            export_weights(folder, path)
        return load_gate(str(path)).sha256

    def plot_reliability(self) -> Figure:
        """Plot predicted against observed shares of hold-out shots; InputError if there are none."""
        if self.folds is None:
            raise InputError("too few configurations to hold any out: 15 at least")
        return draw_reliability(self.folds.p, self.folds.level)

    def lines(self) -> list[str]:
        """Return the report: the learned correction to the physics, and hold-out figures with warnings."""
        gate, marks = self.gate, self.marks
        lines = [*(f"warning: {line}" for line in self.record.get("accepted", ())),
                 *(f"warning: the belief was {other}" for other in [gate.belief.other_rig(gate.rig)] if other),
                 f"learned from {len(marks.level)} shots",
                 *train.tell_residual(gate, marks.features, physics_of(gate.rig, gate.belief, marks.features))]
        if len(set(marks.level[marks.level >= 0])) < 2:
            lines.append("warning: every shot has the same outcome; the gate is the physics and its prior alone")
        if self.folds is None:
            return [*lines, train.tell_too_few(marks.group, marks.level, gate.rig.target)]
        return lines + train.tell_heldout(self.folds, gate.temperature, gate.rig.target)


def train_gate(dataset: Dataset, belief: Belief, *, seed: int = 0, accept: Collection[str] = (),
               progress: Progress | None = None) -> GateTraining:
    """Train a gate from the belief's forecast of each shot, a small learned correction and a calibrated spread.

    The gate learns from all shots. Hold-out figures leave out each fifth of the configurations in turn.

    Args:
        dataset: Recorded shots with outcome, distance_m [m], hood_deg [deg] and motor_ratio [1].
        belief: Coefficients of a fit or finding; with scatter and covariance it also forecasts the spread.
        seed: Seed of the folds.
        accept: Names of plausibility checks whose objections are accepted; recorded.
        progress: Called with the share done, 0 to 1, and a note; None: a bar with the time left.

    Raises:
        InputError: implausible data, a negative seed, or no usable shots.
    """
    check_kind("dataset", dataset, Dataset, "load_dataset(...)")
    check_kind("belief", belief, Belief, "load_belief(...)")
    if seed < 0:
        raise InputError(f"seed is {seed}; it cannot be negative")
    dataset = check_plausible(dataset, accept)
    name = dataset.shots.source
    shots = dataset.in_order().shots
    marks, left_out = train.outcome_classes_of(shots, name, dataset.rig.target)
    gate, folds = train.train_physics_gate(dataset.rig, belief, shots, seed, name,
                                           progress or show_progress("train"))
    return GateTraining(gate, folds, tuple(left_out), marks, _record(dataset, belief, seed, marks, gate, folds))


def _record(dataset: Dataset, belief: Belief, seed: int, marks: train.OutcomeClasses, gate: PhysicsGate,
            folds: train.Heldout | None) -> dict[str, Any]:
    figures = None if folds is None else {
        name: {key: value if value == value else None for key, value in one._asdict().items()}
        for name, one in (("physics", folds.physics), ("gate", folds.calibrated))}
    target = facing_up_of(dataset.rig)
    return {"version": version("truearc"), "seed": seed, "shots": len(marks.level),
            "real_sha256": hash_dataset(dataset), "coefficients": belief.coefficients, "scatter": belief.scatter,
            "temperature": gate.temperature, **({} if target is None else {"target": target}),
            **({"accepted": dataset.accepted} if dataset.accepted else {}),
            "heldout": figures, "domain": domain_of(marks.features),
            "recorded": dict(zip(marks.shot_id.tolist(), marks.features.tolist(), strict=True))}
