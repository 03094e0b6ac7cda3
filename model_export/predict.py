"""A gate's probabilities for the shots of a dataset."""

import numpy as np

from truearc.robot.config.schema import InputError
from truearc.robot.gate.contract import FEATURES, NOVELTY, OUTPUTS
from truearc.robot.gate.model import Gate
from truearc.sim.data.dataset import Shots

HEADER = ("shot_id", *OUTPUTS, "in_domain", NOVELTY)
NAMED = 5                             # shots that a message names before it only counts


def features_of(shots: Shots, name: str) -> np.ndarray:
    """Feature rows [n, 3] of dataset `name` in the contract's order; InputError names column and shots that lack
    one."""
    for feature in FEATURES:
        lacking = [shots.shot_id[row] for row in np.flatnonzero(np.isnan(shots.number(feature.name)))]
        if lacking:
            more = f" and {len(lacking) - NAMED} more" if len(lacking) > NAMED else ""
            raise InputError(f"{name}: column {feature.name}: no value for shot_id {', '.join(lacking[:NAMED])}{more}")
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
