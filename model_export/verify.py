"""Checks of an exported gate, including agreement with its trainer, and the gate's probabilities for a dataset."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from truearc.errors import InputError
from truearc.model_export.graph import Trained, load_trained
from truearc.robot.gate import FEATURES, NOVELTY, NOVELTY_LIMIT, OUTPUTS, Gate, load_gate, say_target
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.printed import Printed

GRID = "grid over the domain"
HEADER = ("shot_id", *OUTPUTS, "in_domain", NOVELTY)
NAMED = 5                             # shots that a message names before it only counts
# Of one and the same graph on other numbers of rows: float32 sums of several hundred products in another order. Found:
# up to 3e-4 on gates from 20 datasets; below what a graph may differ from its trainer (model_export/graph.py).
REPEAT_TOLERANCE = 1e-3
# Of novelty: |z - y|^2 from products of float32, a small difference of large numbers where a row is a landmark.
NOVELTY_TOLERANCE = 5e-3
THRESHOLD = 0.5
GRID_POINTS = 31                      # along each feature
SINGLES = 500                         # rows that are also rated one by one


def features_of(shots: Shots, name: str) -> np.ndarray:
    """Return feature rows [n, 3] of dataset `name` in the contract's order; InputError names a column and the shots
    that lack it."""
    for feature in FEATURES:
        lacking = [shots.shot_id[row] for row in np.flatnonzero(np.isnan(shots.number(feature.name)))]
        if lacking:
            more = f" and {len(lacking) - NAMED} more" if len(lacking) > NAMED else ""
            written, *_ = shots.written.get(feature.name, (feature.name,))
            raise InputError(f"{name}: column {written}: no value for shot_id {', '.join(lacking[:NAMED])}{more}")
    return np.stack([shots.number(feature.name) for feature in FEATURES], axis=1)


def rate_shots(gate: Gate, shots: Shots,
               name: str) -> list[tuple[str, float | None, float | None, bool, float | None]]:
    """Return (shot_id, p_two, p_three, in_domain, novelty) per shot; None where the gate gives no number.

    Raises:
        InputError: names `name`, the column and the shots that lack a feature.
    """
    p, inside, novelty = gate.rate_many(features_of(shots, name))
    return [(shot_id, _number(two), _number(three), bool(within), _number(far))
            for shot_id, (two, three), within, far in zip(shots.shot_id, p.tolist(), inside, novelty.tolist(),
                                                          strict=True)]


def _number(value: float) -> float | None:
    return None if np.isnan(value) else value


class Comparison(NamedTuple):
    """Gate against trainer on some rows: the largest difference in either p, and rows whose class differs at 0.5.

    `novelty`: the largest difference in novelty, relative to the trainer's or to 1, whichever is larger. `rows`: the
    number of rows whose p was compared.
    """

    rows: int
    worst: float
    flips: int
    novelty: float
    tolerance: float

    @property
    def passed(self) -> bool:
        """Whether all is within tolerance; a class may flip only where the trainer's own p is that close to 0.5, which
        `worst` covers."""
        return self.worst <= self.tolerance and self.novelty <= NOVELTY_TOLERANCE


def domain_grid(gate: Gate, points: int = GRID_POINTS) -> np.ndarray:
    """Return features [points^3, 3] on an even grid over the gate's domain, including its faces."""
    axes = [np.linspace(low, high, points) for low, high in gate.domain]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))


def compare(gate: Gate, trained: Trained, features: np.ndarray) -> Comparison:
    """Compare onnxruntime's p and novelty with the trainer's float64, on rows [n, 3] rounded to float32.

    If p is valid only inside the domain (`trained.bounded`), it is compared only on the rows inside.
    """
    features = np.asarray(features, np.float32).astype(np.float64)
    given, own = gate.rate_many(features), trained.novelty(features)
    novelty = _largest((given.novelty - own) / np.maximum(own, 1.0))
    kept = given.in_domain if trained.bounded else np.ones(len(features), bool)
    p, wanted = given.p[kept], trained.probabilities(features[kept])
    flips = ((p >= THRESHOLD) != (wanted >= THRESHOLD)).any(axis=1)
    return Comparison(int(kept.sum()), _largest(p - wanted), int(flips.sum()), novelty, trained.tolerance)


def _largest(difference: np.ndarray) -> float:
    """The largest absolute value; infinite when one is not a number."""
    return float(np.where(np.isnan(difference), np.inf, np.abs(difference)).max(initial=0.0))


def find_faults(gate: Gate, features: np.ndarray) -> list[str]:
    """Find a gate's own faults on rows [n, 3]: missing numbers, no repeatability, batches unlike single rows."""
    faults = []
    p, inside, novelty = gate.rate_many(features)
    if np.isnan(p).any():
        faults.append(f"{int(np.isnan(p).any(axis=1).sum())} of {len(features)} rows get no probability")
    again = gate.rate_many(features)
    if not np.array_equal(p, again.p, equal_nan=True) or not np.array_equal(novelty, again.novelty, equal_nan=True):
        faults.append("the same rows rated twice get different probabilities or novelty")
    chosen = np.unique(np.linspace(0, len(features) - 1, SINGLES).astype(int))
    singles = [gate.rate(*map(float, features[row])) for row in chosen]
    alone = np.array([[np.nan, np.nan] if one.p_two is None else [one.p_two, one.p_three] for one in singles])
    if not np.allclose(alone, p[chosen], rtol=0.0, atol=REPEAT_TOLERANCE, equal_nan=True):
        faults.append("rows rated alone and rated together get different probabilities")
    on_the_edge = np.abs(novelty[chosen] - NOVELTY_LIMIT) <= NOVELTY_TOLERANCE
    differ = np.array([one.in_domain for one in singles], bool) != inside[chosen]
    if (differ & ~on_the_edge).any():
        faults.append("rows rated alone and rated together disagree on the domain")
    return faults


@dataclass(frozen=True)
class Verification(Printed):
    """The result of checking a gate: `report`, line by line, and whether it `passed`."""

    report: tuple[str, ...]
    passed: bool

    def lines(self) -> list[str]:
        """Return the report."""
        return list(self.report)


def verify_gate(path: str | Path, weights: str | Path | None = None,
                data: Mapping[str, Dataset] | None = None) -> Verification:
    """Check an exported gate: its contract, its repeatability, and its agreement with its trainer.

    Args:
        path: The ONNX file.
        weights: The directory that it was exported from; None: no comparison with the trainer.
        data: {name: dataset} whose shots are rated in addition to a grid over the domain.

    Raises:
        InputError: the file is not a gate, or a directory or dataset is unusable.
    """
    gate = load_gate(str(path))
    trained = None if weights is None else load_trained(weights)
    domain = ", ".join(f"{feature.name} {low:.3f} to {high:.3f}"
                       for feature, (low, high) in zip(FEATURES, gate.domain, strict=True))
    lines = [f"{path}: sha256 {gate.sha256}", "contract: agrees",
             *([f"target: it {say_target(gate.target)}"] if gate.target else []), f"domain: {domain}"]
    sets = [(GRID, domain_grid(gate))]
    sets += [(name, features_of(one.shots, name)) for name, one in (data or {}).items()]
    checked = [_check(gate, trained, name, features) for name, features in sets]
    lines += [line for one in checked for line in one.report]
    passed = all(one.passed for one in checked)
    if trained is None:
        lines.append("not compared with the trainer (no --weights)")
    elif gate.provenance.get("weights_sha256") != trained.sha256:
        lines.append(f"{weights}: FAILED: not the weights that this gate was exported from")
        passed = False
    return Verification(tuple(lines), passed)


def _check(gate: Gate, trained: Trained | None, name: str, features: np.ndarray) -> Verification:
    faults, lines = find_faults(gate, features) if len(features) else [], []
    if trained is not None:
        result = compare(gate, trained, features)
        aside = f" ({len(features) - result.rows} outside the domain left out)" if result.rows < len(features) else ""
        lines.append(f"{name}: {result.rows} rows{aside}, max |dp| {result.worst:.2e}, {result.flips} class flips at "
                     f"0.5, max |d novelty| {result.novelty:.1e}")
        if not result.rows and name == GRID:
            faults.append("nothing of it is inside the domain, so the gate will always hold: shots vary too little")
        if not result.passed:
            faults.append(f"onnxruntime and trainer differ by more than {trained.tolerance:g} in p "
                          f"or {NOVELTY_TOLERANCE:g} in novelty")
    lines += [f"{name}: FAILED: {fault}" for fault in faults]
    if trained is None and not faults:
        lines.append(f"{name}: {len(features)} rows, repeatable, alone as together")
    return Verification(tuple(lines), not faults)
