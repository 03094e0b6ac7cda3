"""An exported gate against the trainer that made it, and against itself."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from truearc.model_export.trained import Trained, load_trained
from truearc.robot.gate.contract import NOVELTY_LIMIT
from truearc.robot.gate.model import Gate

# Of one and the same graph on other numbers of rows: float32 sums of several hundred products in another order. Found:
# 1.5e-5 on a gate from 59 shots; far below what a graph may differ from its trainer (model_export/trained.py).
REPEAT_TOLERANCE = 1e-4
# Of novelty: |z - y|^2 from products of float32, a small difference of large numbers where a row is a landmark.
NOVELTY_TOLERANCE = 5e-3
THRESHOLD = 0.5
GRID_POINTS = 31                      # along each feature
SINGLES = 500                         # rows that are also rated one by one


class Comparison(NamedTuple):
    """Gate against trainer on some rows: the largest difference in either p, and rows whose class differs at 0.5.

    `novelty`: the largest difference there, as a share of the trainer's or of 1, whichever is larger. `rows`: of which
    p was compared.
    """

    rows: int
    worst: float
    flips: int
    novelty: float
    tolerance: float

    @property
    def passed(self) -> bool:
        """A class may flip only where the trainer's own p is within the tolerance of 0.5; `worst` covers that."""
        return self.worst <= self.tolerance and self.novelty <= NOVELTY_TOLERANCE


def domain_grid(gate: Gate, points: int = GRID_POINTS) -> np.ndarray:
    """Features [points^3, 3] on an even grid over the gate's domain, its faces included."""
    axes = [np.linspace(low, high, points) for low, high in gate.domain]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))


def is_exported_from(gate: Gate, directory: str | Path) -> bool:
    """Whether the weights directory has the hash that export stamped into the gate; BadInput when it is unreadable."""
    return bool(gate.provenance.get("weights_sha256") == load_trained(directory).sha256)


def compare(gate: Gate, trained: Trained, features: np.ndarray) -> Comparison:
    """onnxruntime's p and novelty against the trainer's own float64, on rows [n, 3] as float32 carries them.

    A gate whose p is meant inside its domain only (`trained.bounded`) is compared in p on the rows inside it.
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
    """What is wrong with a gate by itself on rows [n, 3]: no number, not repeatable, or batches unlike single rows."""
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
