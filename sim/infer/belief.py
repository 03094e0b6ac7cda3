"""What we believe of a launcher: coefficients, shot-to-shot scatter of the launch, and how well each is known.

A coefficients.toml with two more tables, which a fit by likelihood writes and the grid does not:

    [scatter]
    speed = 0.021                     # standard deviation of the log of the exit speed
    elevation_deg = 0.5               # standard deviation of the exit elevation
    [covariance]
    names = ["drag.cd", "scatter.speed"]
    matrix = [[0.01, 0.0], [0.0, 0.04]]

The matrix is that of the numbers on each parameter's own scale (truearc.sim.physics.term_fields, named by its prior
in the catalogue; scatters: their logarithm), on which the belief is about normal. The points of a curve
(truearc.sim.infer.curve) are numbers, too: "curve.free_speed.0", "curve.free_speed.1", ...
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from truearc.errors import InputError, make_toml, parse_table, save_whole
from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.columns import WHEEL
from truearc.sim.data.dataset import Shots
from truearc.sim.infer.coefficients import SCHEMA, Coefficients, coefficients_in, load_table
from truearc.sim.infer.curve import Curve, read_curves, write_curve
from truearc.sim.physics.catalogue import Catalogue, as_catalogue, catalogue, find_parameter
from truearc.sim.physics.nonparametric import CURVE, NAMELESS
from truearc.sim.physics.term_fields import LINEAR, LOG, fits_scale, from_scale, to_scale
from truearc.sim.printed import Printed

SCATTERS = ("speed", "elevation_deg")
SCATTER = "scatter"


RANGED = ("distance_m", "hood_deg", "motor_ratio", "exit_speed_m_s", "exit_deg", "exit_spin_rev_s")


def ranges_of(shots: Shots) -> dict[str, list[float]]:
    """Return {column: [lowest, highest]} of the settings of shots, for the provenance of what is fitted to them."""
    known = {name: column[np.isfinite(column)] for name, column in shots.numbers.items()
             if name in RANGED or WHEEL.fullmatch(name)}
    return {name: [float(column.min()), float(column.max())] for name, column in known.items() if len(column)}


def launcher_of(rig: Rig) -> dict[str, float]:
    """Return ball and launcher of a rig by dotted keys, for the provenance of what is fitted to its shots."""
    wheels = {f"launcher.wheel.{wheel.name}.{key}": float(getattr(wheel, key)) for wheel in rig.launcher.wheel
              for key in ("radius_m", "gear", "clock_deg")}
    free = {} if rig.launcher.free_speed_rad_s is None else {
        "launcher.free_speed_rad_s": float(rig.launcher.free_speed_rad_s)}
    return {"ball.mass_kg": float(rig.ball.mass_kg), "ball.radius_m": float(rig.ball.radius_m), **free, **wheels}


@dataclass(frozen=True, eq=False)
class Belief(Printed):
    """Coefficients with scatter and uncertainty.

    coefficients: {term: {parameter: value}}. scatter: {"speed": sd of the log of the exit speed from shot to shot,
    "elevation_deg": sd of the exit elevation}, empty when it was not fitted. names: "term.parameter" or "scatter.x",
    one per row of `covariance` [p, p], which is on the parameters' own scales (module docstring); others are exact.
    curves: sizes of unexplained effects, by their terms of truearc.sim.physics.nonparametric in `coefficients`.
    catalogue: of the terms that the coefficients name.
    provenance: how the belief came about, in plain values that a file keeps; nothing is computed from it.
    """

    coefficients: Coefficients
    scatter: dict[str, float]
    names: tuple[str, ...]
    covariance: Float[np.ndarray, "p p"]
    curves: dict[str, Curve] = field(default_factory=dict)
    catalogue: Catalogue = field(default_factory=catalogue)
    provenance: dict[str, Any] = field(default_factory=dict)

    def other_rig(self, rig: Rig) -> str:
        """Say how a rig differs from the one that the belief was fitted to; "" where it does not, or is unknown."""
        fitted = self.provenance.get("rig")
        if not isinstance(fitted, Mapping):
            return ""
        here = launcher_of(rig)
        differ = [f"{key} is {here.get(key, 'absent')}, was {fitted.get(key, 'absent')}"
                  for key in dict.fromkeys((*fitted, *here)) if here.get(key) != fitted.get(key)]
        return f"fitted to another rig: {', '.join(differ)}" if differ else ""

    def values(self) -> Float[np.ndarray, " p"]:
        """The named parameters [p] on their scales: the mean that `covariance` goes with."""
        return np.array([float(to_scale(scale_of(name, self.catalogue), self.value(name))) for name in self.names])

    def value(self, name: str) -> float:
        """One parameter by its "term.parameter" or "scatter.x", in its own unit."""
        table, _, key = name.partition(".")
        if table == CURVE:
            term, _, point = key.partition(".")
            return self.curves[term].point(point)
        return self.scatter[key] if table == SCATTER else self.coefficients[table][key]

    def has(self, name: str) -> bool:
        """Whether there is such a number in it."""
        try:
            self.value(name)
        except KeyError:
            return False
        return True

    def save(self, path: str | Path) -> None:
        """Write a coefficients.toml that `load_belief` reads back exactly.

        Raises:
            InputError: `load_belief` would refuse it; nothing is written.
            OSError: it cannot be written.
        """
        named = {**self.coefficients, **({SCATTER: self.scatter} if self.scatter else {})}
        table: dict[str, Any] = {name: {key: float(value) for key, value in values.items()}
                                 for name, values in named.items()}
        if self.names:
            table["covariance"] = {"names": list(self.names), "matrix": np.asarray(self.covariance, float).tolist()}
        if self.curves:
            table[CURVE] = {term: write_curve(curve) for term, curve in self.curves.items()}
        text = make_toml({"schema": SCHEMA, **table, "provenance": dict(self.provenance)})
        _read(parse_table(text, str(path)), path, self.catalogue)
        save_whole(path, text.encode())

    def lines(self) -> list[str]:
        """Return a line per number: its value, unit, and standard deviation, a factor where its scale is the log."""
        doubt = dict(zip(self.names, np.sqrt(np.diag(self.covariance)), strict=True))
        names = [f"{term}.{key}" for term, values in self.coefficients.items() for key in values]
        return [self._line(name, doubt.get(name)) for name in (*names, *(f"{SCATTER}.{key}" for key in self.scatter))]

    def _line(self, name: str, sd: float | None) -> str:
        scale = scale_of(name, self.catalogue)
        known = "" if sd is None else f" × or / {np.exp(sd):.3g}" if scale == LOG else (
            f" ± {sd:.2g}" if scale == LINEAR else f" ± {sd:.2g} on its {scale} scale")
        scattered = "deg" if name.endswith("_deg") else "1"
        unit = scattered if name.startswith(SCATTER + ".") else find_parameter(name, self.catalogue).unit
        return f"{name:28s} {self.value(name):.4g}{known}{'' if unit == '1' else f' {unit}'}"


def point_belief(coefficients: Mapping[str, Mapping[str, float]], scatter: Mapping[str, float] | None = None,
                 among: Catalogue | None = None) -> Belief:
    """A belief that is certain, such as the grid's pair is."""
    return Belief({name: dict(values) for name, values in coefficients.items()}, dict(scatter or {}), (),
                  np.zeros((0, 0)), catalogue=as_catalogue(among))


def scale_of(name: str, among: Catalogue | None = None) -> str:
    """The scale of a parameter by its name; a parameter that is known, not fitted, has the linear one."""
    if name.startswith(SCATTER + "."):
        return LOG
    prior = find_parameter(name, among).prior
    return prior.scale if prior is not None else LINEAR


def replace_values(belief: Belief, numbers: Float[np.ndarray, " p"]) -> Belief:
    """A point belief whose named parameters have these values, given on their scales [p]."""
    coefficients = {name: dict(values) for name, values in belief.coefficients.items()}
    scatter, points = dict(belief.scatter), dict[str, float]()
    for name, number in zip(belief.names, numbers, strict=True):
        table, _, key = name.partition(".")
        place = {SCATTER: scatter, CURVE: points, **coefficients}[table]
        place[key] = float(from_scale(scale_of(name, belief.catalogue), number))
    return replace(point_belief(coefficients, scatter, belief.catalogue), curves=moved_curves(belief.curves, points))


def moved_curves(curves: Mapping[str, Curve], points: Mapping[str, float]) -> dict[str, Curve]:
    """With these points {"free_speed.0": value} at other values."""
    return {term: curve.moved({key.removeprefix(term + "."): value for key, value in points.items()
                               if key.startswith(term + ".")}) for term, curve in curves.items()}


def draw(belief: Belief, n: int, rng: np.random.Generator) -> list[Belief]:
    """`n` point beliefs, normal on the parameters' scales with the belief's covariance; without one, n times itself."""
    if not belief.names:
        return [replace(point_belief(belief.coefficients, belief.scatter, belief.catalogue), curves=belief.curves)] * n
    drawn = rng.multivariate_normal(belief.values(), belief.covariance, size=n, method="eigh")
    return [replace_values(belief, numbers) for numbers in drawn]


def as_table(belief: Belief) -> dict[str, Any]:
    """Plain values, as JSON has them, that `from_table` makes the same belief of."""
    return {"coefficients": belief.coefficients, "scatter": belief.scatter, "names": list(belief.names),
            "covariance": np.asarray(belief.covariance, float).tolist(),
            CURVE: {term: write_curve(curve) for term, curve in belief.curves.items()}}


def from_table(table: Mapping[str, Any], name: str) -> Belief:
    """The inverse of `as_table`; `name` is for messages. KeyError, ValueError, InputError: not such a table."""
    names = tuple(map(str, table["names"]))
    return Belief(table["coefficients"], table["scatter"], names,
                  np.array(table["covariance"], float).reshape(len(names), len(names)),
                  read_curves(name, table.get(CURVE, {})))


def load_belief(path: str | Path, among: Catalogue | None = None) -> Belief:
    """Read any coefficients.toml; one without [scatter] or [covariance] has an empty one.

    among: the catalogue of the terms that it may name, truearc.sim.physics.catalogue.catalogue() when not given.

    InputError names the file and key of what is not known, no number, out of its range, or no covariance.
    """
    return _read(load_table(path), path, among)


def _read(table: dict[str, Any], path: str | Path, among: Catalogue | None) -> Belief:
    coefficients = coefficients_in(table, path, among)
    provenance = table.get("provenance", {})
    if not isinstance(provenance, dict):
        raise InputError(f"{path}: provenance is not a table")
    scatter = _scatter(path, table.get("scatter", {}))
    names, covariance = _covariance(path, table.get("covariance", {}))
    curves = read_curves(path, table.get(CURVE, {}))
    taking = [term.name for term in NAMELESS if term.name in coefficients]
    for term in curves:
        if term not in taking:
            raise InputError(f"{path}: curve.{term}: no term takes it, such as [free_speed] takes [curve.free_speed]")
    for term in taking:
        if term not in curves:
            raise InputError(f"{path}: {term}: has no [curve.{term}] to say how large it is")
    belief = Belief(coefficients, scatter, names, covariance, curves, as_catalogue(among), provenance)
    for name in names:
        _check(path, name, belief)
    return belief


def _scatter(path: str | Path, table: Any) -> dict[str, float]:
    if not isinstance(table, dict):
        raise InputError(f"{path}: scatter is not a table")
    for name, value in table.items():
        if name not in SCATTERS:
            raise InputError(f"{path}: scatter.{name}: there is no such scatter ({', '.join(SCATTERS)})")
        if isinstance(value, bool) or not isinstance(value, int | float) or not (0.0 < value < np.inf):
            raise InputError(f"{path}: scatter.{name}: {value!r} is not a number above 0")
    return {name: float(value) for name, value in table.items()}


def _covariance(path: str | Path, table: Any) -> tuple[tuple[str, ...], Float[np.ndarray, "p p"]]:
    if not isinstance(table, dict):
        raise InputError(f"{path}: covariance is not a table")
    names = table.get("names", [])
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names) or len(set(names)) < len(names):
        raise InputError(f"{path}: covariance.names: {names!r} is not a list of different names")
    try:
        matrix = np.array(table.get("matrix", []), dtype=float).reshape(len(names), len(names))
    except (TypeError, ValueError) as error:
        raise InputError(f"{path}: covariance.matrix: not {len(names)} rows of {len(names)} numbers") from error
    if not np.isfinite(matrix).all() or not np.allclose(matrix, matrix.T, rtol=1e-6, atol=1e-12):
        raise InputError(f"{path}: covariance.matrix: not finite and symmetric")
    if names and np.linalg.eigvalsh(matrix).min() < -1e-9 * max(np.trace(matrix), 1e-12):
        raise InputError(f"{path}: covariance.matrix: no covariance, some combination has a negative variance")
    return tuple(names), matrix


def _check(path: str | Path, name: str, belief: Belief) -> None:
    if not belief.has(name):
        raise InputError(f"{path}: covariance.names: {name} has no value in the file")
    scale = scale_of(name, belief.catalogue)
    if not fits_scale(scale, belief.value(name)):
        raise InputError(f"{path}: {name}: {belief.value(name):g} has no place on its scale, which is {scale}")
