"""A weights directory of any kind: what it says of a configuration, and the graph that says the same."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from model_export.parts import Part, network_part
from sim.gate.novelty import Novelty, parse_novelty
from sim.network import RECORD_FILE, load_weights, probabilities

# Sums of eight float32 products behind two sigmoids; a network trained a hundred times longer than the default, with
# weights of 50, differs by 6e-6. More than this is another network, not another rounding.
NETWORK_TOLERANCE = 1e-5
# The graph of a physics gate carries its flights as a polynomial, and export refuses one that is worse than this.
PHYSICS_TOLERANCE = 5e-3


@dataclass(frozen=True)
class Trained:
    """`probabilities`: the trainer's own float64 p [n, 2] of features [n, 3]; `tolerance`: of the graph's p to it."""

    kind: str
    record: dict[str, Any]
    probabilities: Callable[[np.ndarray], np.ndarray]
    part: Part
    novelty: Novelty
    tolerance: float


def load_trained(directory: str | Path) -> Trained:
    """Read a weights directory; BadInput names the file and what is wrong with it."""
    network, record = load_weights(directory)
    novelty = parse_novelty(record.get("novelty"), str(Path(directory) / RECORD_FILE))
    return Trained("network", record, lambda features: probabilities(network, features), network_part(network),
                   novelty, NETWORK_TOLERANCE)
