"""An exported gate against the trainer that made it, and against itself."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from robot.gate.model import Gate
from sim.network import Network, probabilities, weights_hash

# Sums of eight float32 products behind two sigmoids; a network trained a hundred times longer than the default, with
# weights of 50, differs by 6e-6. More than this is another network, not another rounding.
TOLERANCE = 1e-5
THRESHOLD = 0.5
GRID_POINTS = 31                      # along each feature
SINGLES = 500                         # rows that are also rated one by one


class Comparison(NamedTuple):
    """Gate against trainer on some rows: the largest difference in either p, and rows whose class differs at 0.5."""

    rows: int
    worst: float
    flips: int

    @property
    def passed(self) -> bool:
        """A class may flip only where the trainer's own p is within the tolerance of 0.5; `worst` covers that."""
        return self.worst <= TOLERANCE


def domain_grid(gate: Gate, points: int = GRID_POINTS) -> np.ndarray:
    """Features [points^3, 3] on an even grid over the gate's domain, its faces included."""
    axes = [np.linspace(low, high, points) for low, high in gate.domain]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))


def is_exported_from(gate: Gate, directory: str | Path) -> bool:
    """Whether the weights directory has the hash that export stamped into the gate; BadInput when it is unreadable."""
    return bool(gate.provenance.get("weights_sha256") == weights_hash(directory))


def compare(gate: Gate, network: Network, features: np.ndarray) -> Comparison:
    """onnxruntime's p against the trainer's float64 forward pass, on rows [n, 3] as float32 carries them."""
    features = np.asarray(features, np.float32).astype(np.float64)
    given, _ = gate.rate_many(features)
    wanted = probabilities(network, features)
    difference = np.abs(given - wanted)
    flips = ((given >= THRESHOLD) != (wanted >= THRESHOLD)).any(axis=1)
    worst = float(np.where(np.isnan(difference), np.inf, difference).max(initial=0.0))
    return Comparison(len(features), worst, int(flips.sum()))


def find_faults(gate: Gate, features: np.ndarray) -> list[str]:
    """What is wrong with a gate by itself on rows [n, 3]: no number, not repeatable, or batches unlike single rows."""
    faults = []
    p, inside = gate.rate_many(features)
    if np.isnan(p).any():
        faults.append(f"{int(np.isnan(p).any(axis=1).sum())} of {len(features)} rows get no probability")
    again, _ = gate.rate_many(features)
    if not np.array_equal(p, again, equal_nan=True):
        faults.append("the same rows rated twice get different probabilities")
    chosen = np.unique(np.linspace(0, len(features) - 1, SINGLES).astype(int))
    singles = [gate.rate(*map(float, features[row])) for row in chosen]
    alone = np.array([[np.nan, np.nan] if one.p_two is None else [one.p_two, one.p_three] for one in singles])
    if not np.allclose(alone, p[chosen], rtol=0.0, atol=TOLERANCE, equal_nan=True):
        faults.append("rows rated alone and rated together get different probabilities")
    if [one.in_domain for one in singles] != inside[chosen].tolist():
        faults.append("rows rated alone and rated together disagree on the domain")
    return faults
