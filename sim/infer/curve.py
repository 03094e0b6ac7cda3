"""Free curves of unexplained effects: how their sizes go with a covariate, and what they are at every shot.

    [free_speed]                      # what it changes, a term of truearc.sim.physics.nonparametric
    share = 1.0
    [curve.free_speed]
    covariate = "distance_m"          # absent: the same in every shot
    at = [2.1, 3.4, 4.6, 5.8, 7.2]    # or levels = ["north", "south"] of a text column
    value = [0.0, 0.0, 0.01, 0.03, 0.06]
    low = 1.9                         # beyond what was recorded it goes on level
    high = 7.6
    otherwise = 0.02                  # where the covariate is unknown: the mean of what was recorded

Between the knots it is the natural cubic spline of discovery's own fit, beyond the outer ones straight.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from jaxtyping import Float
from msgspec import Struct
from scipy.interpolate import CubicSpline

from truearc.errors import InputError, reworded
from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.conditions import ORDINARY, Circumstances
from truearc.sim.data.dataset import Shots
from truearc.sim.physics.simulate import launch_state

Columns = Mapping[str, Any]           # name -> numbers [n], or texts (n of them)
Curves = Mapping[str, "Curve"]        # by the term of truearc.sim.physics.nonparametric that takes it


class Curve(Struct, frozen=True, forbid_unknown_fields=True):
    """As above; `value` goes with `at`, or with `levels`."""

    value: tuple[float, ...]
    otherwise: float
    covariate: str = ""
    at: tuple[float, ...] = ()
    levels: tuple[str, ...] = ()
    low: float = -np.inf
    high: float = np.inf

    @property
    def points(self) -> Float[np.ndarray, " points"]:
        """The numbers [K + 1] that it is linear in: `value`, then `otherwise`."""
        return np.array([*self.value, self.otherwise])

    @property
    def keys(self) -> tuple[str, ...]:
        """Names of the points: their numbers."""
        return tuple(map(str, range(len(self.value) + 1)))

    @property
    def fitted(self) -> tuple[str, ...]:
        """Keys of the points that recordings tell; the mean of what was recorded follows from them."""
        return self.keys[:-1] or self.keys

    def point(self, key: str) -> float:
        """KeyError for a key that there is none of."""
        return float(dict(zip(self.keys, self.points, strict=True))[key])

    def moved(self, points: Mapping[str, float]) -> "Curve":
        """With these points at other values."""
        now = [points.get(key, value) for key, value in zip(self.keys, self.points, strict=True)]
        return msgspec.structs.replace(self, value=tuple(map(float, now[:-1])), otherwise=float(now[-1]))

    def by(self, columns: Columns, n: int) -> Float[np.ndarray, "n points"]:
        """Derivatives [n, K + 1] by the points of its size at shots that have these columns."""
        by = np.zeros((n, len(self.keys)))
        column = columns.get(self.covariate) if self.covariate else None
        if column is not None and self.levels:
            place = {level: k for k, level in enumerate(self.levels)}
            by[np.arange(n), [place.get(text, -1) for text in column]] = 1.0
            return by
        x = np.full(n, np.nan) if column is None else np.asarray(column, dtype=float)
        said = np.isfinite(x)
        by[~said, -1] = 1.0
        if said.any():
            by[said, :-1] = natural(np.array(self.at), np.clip(x[said], self.low, self.high))
        return by


def natural(knots: Float[np.ndarray, " K"], x: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n K"]:
    """[n, K] from values at the knots to those of their natural cubic spline at x, straight beyond the outer knots."""
    spline = CubicSpline(knots, np.eye(len(knots)), bc_type="natural")
    inside = np.clip(x, knots[0], knots[-1])
    return np.asarray(spline(inside) + (x - inside)[:, None] * spline(inside, 1))


def along(curves: Curves, circumstances: Circumstances, columns: Columns, n: int) -> Circumstances:
    """The circumstances of n shots with these columns, the curves' sizes among them."""
    if not curves:
        return circumstances
    by = np.concatenate([curve.by(columns, n) for curve in curves.values()], axis=1)
    points = np.concatenate([curve.points for curve in curves.values()])
    return resized(circumstances._replace(curve_by=by), owners(curves), points)


def owners(curves: Curves) -> tuple[str, ...]:
    """Whose each of all points is, in the order of `Circumstances.curve_by`."""
    return tuple(term for term, curve in curves.items() for _ in curve.keys)


def resized(circumstances: Circumstances, whose: Sequence[str], points: Any) -> Circumstances:
    """With the curves' points at these values [K], or [n, K] of each shot; `whose`: the owners. Differentiable."""
    shares = circumstances.curve_by * points
    mine = {term: np.array([owner == term for owner in whose]) for term in whose}
    return circumstances._replace(**{term: shares[..., here].sum(-1) for term, here in mine.items()})


def before_the_shot(curves: Curves, rig: Rig, shots: Shots) -> Circumstances:
    """Ordinary circumstances of configurations: only the columns of the launch and the distance say how large they are.
    """
    if not curves:
        return ORDINARY
    return along(curves, ORDINARY, {**shots.numbers, **launch_state(rig, shots)}, len(shots))


def read_curves(path: str | Path, tables: Any) -> dict[str, Curve]:
    """From the file's [curve.TERM] tables; InputError names file and key."""
    if not isinstance(tables, dict):
        raise InputError(f"{path}: curve: not one table a term, such as [curve.free_speed]")
    return {str(term): _read(f"{path}: curve.{term}", table) for term, table in tables.items()}


def _read(place: str, table: Any) -> Curve:
    try:
        curve = msgspec.convert(table, Curve)
    except msgspec.ValidationError as error:
        raise InputError(f"{place}: {reworded(str(error), table)}") from error
    numbers = (*curve.value, *curve.at, curve.otherwise)
    if not np.isfinite(numbers).all():
        raise InputError(f"{place}: a number in it is not finite")
    if curve.covariate and len(curve.value) != len(curve.levels or curve.at):
        raise InputError(f"{place}.value: {len(curve.value)} of them for {len(curve.levels or curve.at)} places")
    if curve.at and (len(curve.at) < 2 or not (np.diff(curve.at) > 0.0).all()):
        raise InputError(f"{place}.at: not two or more numbers in rising order")
    return curve


def write_curve(curve: Curve) -> dict[str, Any]:
    """The table that reads back as this curve."""
    usual = Curve((), 0.0)
    said = {key: value for key, value in msgspec.structs.asdict(curve).items()
            if key in ("value", "otherwise") or value != getattr(usual, key)}
    return {key: list(value) if isinstance(value, tuple) else value for key, value in said.items()}
