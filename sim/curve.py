"""A free curve of an effect without a name: how its size goes with a covariate, and what it is at every shot.

    [free_speed]                      # what it changes, a term of sim.physics.nameless
    share = 1.0
    [curve]
    covariate = "distance_m"          # absent: the same in every shot
    at = [2.1, 3.4, 4.6, 5.8, 7.2]    # or levels = ["north", "south"] of a text column
    value = [0.0, 0.0, 0.01, 0.03, 0.06]
    low = 1.9                         # beyond what was recorded it goes on level
    high = 7.6
    otherwise = 0.02                  # where the covariate is unknown: the mean of what was recorded

Between the knots it is the natural cubic spline of discovery's own fit, beyond the outer ones straight.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec import Struct
from scipy.interpolate import CubicSpline

from robot.config import BadInput
from robot.facts import Facts
from sim.physics.shot import ORDINARY, launch_state
from sim.physics.term import Circumstances
from sim.shots import Shots

Columns = Mapping[str, Any]           # name -> numbers [n], or texts (n of them)


class Curve(Struct, frozen=True, forbid_unknown_fields=True):
    """As above; `value` goes with `at`, or with `levels`."""

    value: tuple[float, ...]
    otherwise: float
    covariate: str = ""
    at: tuple[float, ...] = ()
    levels: tuple[str, ...] = ()
    low: float = -np.inf
    high: float = np.inf

    def size(self, columns: Columns, n: int) -> np.ndarray:
        """Its size [n] at shots that have these columns."""
        if not self.covariate:
            return np.full(n, self.otherwise)
        column = columns.get(self.covariate)
        if column is None:
            return np.full(n, self.otherwise)
        if self.levels:
            known = dict(zip(self.levels, self.value, strict=True))
            return np.array([known.get(text, self.otherwise) for text in column])
        x = np.asarray(column, dtype=float)
        said = np.isfinite(x)
        return np.where(said, natural(np.array(self.at), np.clip(np.where(said, x, 0.0), self.low, self.high))
                        @ np.array(self.value), self.otherwise)


def natural(knots: np.ndarray, x: np.ndarray) -> np.ndarray:
    """[n, K] from values at the knots to those of their natural cubic spline at x, straight beyond the outer knots."""
    spline = CubicSpline(knots, np.eye(len(knots)), bc_type="natural")
    inside = np.clip(x, knots[0], knots[-1])
    return np.asarray(spline(inside) + (x - inside)[:, None] * spline(inside, 1))


def along(curve: Curve | None, circumstances: Circumstances, columns: Columns, n: int) -> Circumstances:
    """The circumstances of n shots with these columns, the curve's size among them."""
    return circumstances if curve is None else circumstances._replace(curve=curve.size(columns, n))


def before_the_shot(curve: Curve | None, facts: Facts, shots: Shots) -> Circumstances:
    """Ordinary circumstances of configurations: only the columns of the launch and the distance say how large it is."""
    if curve is None:
        return ORDINARY
    return along(curve, ORDINARY, {**shots.numbers, **launch_state(facts, shots)}, len(shots))


def read_curve(path: str | Path, table: Any) -> Curve | None:
    """From the file's [curve] table, if it has one; BadInput names file and key."""
    if table is None:
        return None
    try:
        curve = msgspec.convert(table, Curve)
    except msgspec.ValidationError as error:
        raise BadInput(f"{path}: curve: {error}") from error
    numbers = (*curve.value, *curve.at, curve.otherwise)
    if not np.isfinite(numbers).all():
        raise BadInput(f"{path}: curve: a number in it is not finite")
    if curve.covariate and len(curve.value) != len(curve.levels or curve.at):
        raise BadInput(f"{path}: curve.value: {len(curve.value)} of them for {len(curve.levels or curve.at)} places")
    if curve.at and (len(curve.at) < 2 or not (np.diff(curve.at) > 0.0).all()):
        raise BadInput(f"{path}: curve.at: not two or more numbers in rising order")
    return curve


def write_curve(curve: Curve) -> dict[str, Any]:
    """The table that reads back as this curve."""
    usual = Curve((), 0.0)
    said = {key: value for key, value in msgspec.structs.asdict(curve).items()
            if key in ("value", "otherwise") or value != getattr(usual, key)}
    return {key: list(value) if isinstance(value, tuple) else value for key, value in said.items()}
