"""What networks are trained on and judged by: rows of shots, their splits, the loss, the accuracy, the domain.

The training itself is in `truearc.sim.paper.sweep`.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from truearc.errors import InputError
from truearc.robot.gate.contract import FEATURES
from truearc.sim import statistics as figures
from truearc.sim.data.dataset import Shots
from truearc.sim.paper.network import Network, logits, probabilities

LABELS = {"miss": (0.0, 0.0), "two": (1.0, 0.0), "three": (1.0, 1.0)}     # three lies inside two
DOMAIN_MARGIN = 0.1                   # the domain is the recorded rows' box, wider by this share (half on each side)


class Rows(NamedTuple):
    """Training rows: `features` [n, 3] in the contract's order and units, `labels` [n, 2] (hit two, hit three)."""

    features: np.ndarray
    labels: np.ndarray


def training_rows(shots: Shots, name: str) -> tuple[Rows, list[str]]:
    """Rows with an outcome and all three features, and a sentence for each kind of shot of dataset `name` left out."""
    outcomes = shots.text("outcome")
    unjudged = np.array([outcome not in LABELS for outcome in outcomes], bool)
    features, kept, left_out = usable_rows(shots, name, unjudged, "no outcome")
    labels = np.array([LABELS[outcomes[row]] for row in kept], float).reshape(-1, 2)
    return Rows(features, labels), left_out


def usable_rows(shots: Shots, name: str, silent: np.ndarray, why: str) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """(features [k, 3], their rows in `shots` [k], a sentence for each kind of shot of dataset `name` left out).

    Rows lack no feature, and are not `silent` [n], which `why` explains. InputError when none is left.
    """
    features = np.stack([shots.number(feature.name) for feature in FEATURES], axis=1)
    gaps = np.isnan(features)
    lacking = " or ".join(f"no {shots.written.get(feature.name, feature.name)}"
                          for feature, lacks in zip(FEATURES, gaps[~silent].T, strict=True) if lacks.any())
    gap = gaps.any(axis=1) & ~silent
    left_out = [f"{name}: {int(rows.sum())} of {len(shots)} shots left out: {reason}"
                for reason, rows in ((why, silent), (lacking, gap)) if rows.any()]
    kept = np.flatnonzero(~silent & ~gap)
    if not kept.size:
        raise InputError("there is nothing to train on; " + "; ".join(left_out or [f"{name}: no shots"]))
    return features[kept], kept, left_out


def cross_entropy(log_odds: Any, labels: Any) -> Any:
    """Binary cross-entropy of each row, summed over the two outputs: log odds [n, 2], labels [n, 2] -> [n] nats."""
    return jnp.sum(jax.nn.softplus(log_odds) - labels * log_odds, axis=-1)


def mean_loss(network: Network, rows: Rows) -> float:
    """Mean cross-entropy of at least one row, in nats."""
    z = (rows.features - network.mean) * network.scale
    return float(jnp.mean(cross_entropy(logits(network.layers, z), rows.labels)))


def split_heldout(rows: Rows, share: float, seed: int, option: str = "--holdout") -> tuple[Rows, Rows]:
    """(kept, held out): `share` of each class is held out, drawn by seed, a draw of its own for each option.

    InputError names the option unless 0 <= share < 1.
    """
    if not 0.0 <= share < 1.0:
        raise InputError(f"{option} is {share}; it must be at least 0 and less than 1")
    rng = np.random.default_rng([seed, 1, *(() if option == "--holdout" else option.encode())])
    level = rows.labels.sum(axis=1)
    out = np.zeros(len(level), bool)
    for value in np.unique(level):
        members = rng.permutation(np.flatnonzero(level == value))
        out[members[:round(share * len(members))]] = True
    return Rows(*(array[~out] for array in rows)), Rows(*(array[out] for array in rows))


def accuracy(network: Network, rows: Rows) -> dict[str, Any]:
    """Share of rows whose outcome (of three), two-point hit and three-point hit are called right at p = 0.5.

    Keys: shots, outcome, two, three; the shares are None when there are no rows.
    """
    if not len(rows.features):
        return {"shots": 0, "outcome": None, "two": None, "three": None}
    p, hit = probabilities(network, rows.features), rows.labels >= 0.5
    two, three = ((p >= 0.5) == hit).mean(axis=0).tolist()
    return {"shots": len(rows.features), "outcome": figures.accuracy(p, hit), "two": two, "three": three}


def domain_of(features: np.ndarray) -> dict[str, list[float]]:
    """Where the model may be believed: the box around the recorded rows [n, 3], 10 % wider, within the contract.

    Simulated rows do not widen it: they cover configurations that no robot has shown anything about.
    """
    low, high = features.min(axis=0), features.max(axis=0)
    margin = 0.5 * DOMAIN_MARGIN * (high - low)
    return {feature.name: [float(max(feature.low, low[k] - margin[k])), float(min(feature.high, high[k] + margin[k]))]
            for k, feature in enumerate(FEATURES)}
