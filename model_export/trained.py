"""A weights directory of any kind: what it says of a configuration, and the graph that says the same."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from truearc.model_export.parts import Part, network_part, physics_part
from truearc.model_export.tolerances import NETWORK_TOLERANCE, PHYSICS_TOLERANCE
from truearc.sim.gate.novelty import Novelty, parse_novelty
from truearc.sim.gate.store import KIND, MODEL_FILE, load_physics_gate
from truearc.sim.gate.surrogate import Domain, make_surrogate
from truearc.sim.paper.network import RECORD_FILE, load_weights, probabilities, weights_hash


@dataclass(frozen=True)
class Trained:
    """`probabilities`: the trainer's own float64 p [n, 2] of features [n, 3]; `tolerance`: of the graph's p to it.

    `make_part` makes the nodes that give p, figures of their own for the provenance, and the domain over which they do;
    `sha256`: of the directory.
    """

    kind: str
    record: dict[str, Any]
    sha256: str
    probabilities: Callable[[np.ndarray], np.ndarray]
    make_part: Callable[[], tuple[Part, dict[str, Any], Domain]]
    novelty: Novelty
    tolerance: float
    bounded: bool                     # the graph's p means something inside the domain only


def load_trained(directory: str | Path) -> Trained:
    """Read a weights directory; InputError names the file and what is wrong with it."""
    if (Path(directory) / MODEL_FILE).is_file():
        return _physics(directory)
    network, record = load_weights(directory)
    novelty = parse_novelty(record.get("novelty"), str(Path(directory) / RECORD_FILE))
    return Trained("network", record, weights_hash(directory), lambda features: probabilities(network, features),
                   lambda: (network_part(network), {}, record["domain"]), novelty, NETWORK_TOLERANCE, False)


def _physics(directory: str | Path) -> Trained:
    gate, record = load_physics_gate(directory)

    def make_part() -> tuple[Part, dict[str, Any], Domain]:
        surrogate, errors, domain = make_surrogate(gate, record["domain"])
        return physics_part(surrogate, gate.shape, gate.aside), {"surrogate": {
            "degree": surrogate.degree, "mean_error_m": errors.mean_m, "p_error": errors.p}}, domain

    return Trained(KIND, record, weights_hash(directory, MODEL_FILE), gate.probabilities, make_part, gate.novelty,
                   PHYSICS_TOLERANCE, True)
