"""What a gate makes of the shots of a dataset."""

import csv
import io

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


def make_ratings(gate: Gate, shots: Shots, name: str) -> str:
    """CSV text `shot_id,p_two,p_three,in_domain,novelty`, a row a shot; a number that there is none of is empty."""
    ratings = gate.rate_many(features_of(shots, name))
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(HEADER)
    for shot_id, p, inside, novelty in zip(shots.shot_id, *(column.tolist() for column in ratings), strict=True):
        writer.writerow([shot_id, *map(_cell, p), "true" if inside else "false", _cell(novelty)])
    return out.getvalue()


def _cell(value: float) -> str:
    return "" if np.isnan(value) else repr(value)
