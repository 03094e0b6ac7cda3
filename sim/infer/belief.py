"""A belief about a launcher: coefficients, free curves and launch scatter, with their uncertainty.

    schema = "truearc.coefficients/1"
    [drag]
    cd = 0.91
    [magnus]
    cl = 0.06
    [provenance]
    method = "grid"

A likelihood fit adds two tables that the grid fit does not write:

    [scatter]
    speed = 0.021                     # standard deviation of the log of the exit speed
    elevation_deg = 0.5               # standard deviation of the exit elevation
    [covariance]
    names = ["drag.cd", "scatter.speed"]
    matrix = [[0.01, 0.0], [0.0, 0.04]]

The matrix is the covariance of the numbers, each on its parameter's own scale, on which the belief is approximately
normal. The prior in the catalogue gives this scale (truearc.sim.physics.term); for scatters it is the logarithm.

An unexplained effect is a free curve, which gives its size as a function of a covariate:

    [free_speed]                      # the changed quantity, a term of truearc.sim.physics.catalogue
    share = 1.0
    [curve.free_speed]
    covariate = "distance_m"          # absent: the same in every shot
    at = [2.1, 3.4, 4.6, 5.8, 7.2]    # or levels = ["north", "south"] of a text column
    value = [0.0, 0.0, 0.01, 0.03, 0.06]
    low = 1.9                         # constant beyond the recorded range
    high = 7.6
    otherwise = 0.02                  # if the covariate is unknown: the mean over the recorded shots

Between the knots, the curve is the natural cubic spline of discovery's own fit; beyond the outer knots, it is a
straight line. Its points are also numbers of the belief: "curve.free_speed.0", "curve.free_speed.1", ...

The room that a fit leaves for what its model gets wrong (truearc.sim.infer.room) is a sum of smooth curves, whose
uncertainty is in the covariance, like that of any number:

    [curve.free_speed]
    value = [0.002, ...]              # a constant, then SHAPES for each covariate
    otherwise = 0.0
    [curve.free_speed.over]
    distance_m = [1.9, 7.6]           # constant beyond this range
    hood_deg = [32.0, 64.0]

If the shots tell balls apart, the belief states how much the balls differ, as standard deviations (that of the speed is
a share of it):

    [balls]
    speed = 0.011
    "drag.cd" = 0.02
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from jaxtyping import Float
from msgspec import Struct
from scipy.interpolate import CubicSpline

from truearc.errors import InputError, load_text, make_toml, parse_table, reworded, save_whole
from truearc.robot.config.rig_spec import Rig
from truearc.sim.data.dataset import ORDINARY, Circumstances, Shots
from truearc.sim.data.table import WHEEL
from truearc.sim.physics import catalogue as terms
from truearc.sim.physics.catalogue import CURVE, NAMELESS, Catalogue
from truearc.sim.physics.simulate import launch_state
from truearc.sim.physics.term import LINEAR, LOG, fits_scale, from_scale, to_scale
from truearc.sim.printed import Printed

SCHEMA = "truearc.coefficients/1"
APART = ("schema", "scatter", "covariance", "curve", "balls", "provenance")

Coefficients = dict[str, dict[str, float]]


def coefficients_in(table: dict[str, Any], path: str | Path, among: Catalogue | None = None) -> Coefficients:
    """Return {term: {parameter: value}} of a loaded file; InputError names an unknown term or parameter, or a value
    that is not finite.

    among: the catalogue of the terms, truearc.sim.physics.catalogue.catalogue() by default.
    """
    return {name: _values(path, name, values, among) for name, values in table.items() if name not in APART}


def load_table(path: str | Path) -> dict[str, Any]:
    """Load all tables of the file; InputError if it is not a coefficients file."""
    table = parse_table(load_text(path), str(path))
    if table.get("schema") != SCHEMA:
        raise InputError(f"{path}: schema is {table.get('schema')!r}, not {SCHEMA!r}")
    return table


def _values(path: str | Path, name: str, values: Any, among: Catalogue | None) -> dict[str, float]:
    try:
        (term,) = terms.find_terms([name], among)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    known = {parameter.name: parameter for parameter in term.parameters}
    if not isinstance(values, dict):
        raise InputError(f"{path}: {name} is not a table")
    for key, value in values.items():
        if key not in known:
            raise InputError(f"{path}: {name}.{key}: {name} has no such parameter ({', '.join(sorted(known))})")
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise InputError(f"{path}: {name}.{key}: {value!r} is not a finite number")
        if value < 0.0 and (prior := known[key].prior) is not None and prior.scale == LOG:
            raise InputError(f"{path}: {name}.{key}: {value:g} is below 0, which it cannot be")
    return {key: float(value) for key, value in values.items()}


Columns = Mapping[str, Any]           # name -> numbers [n], or texts (n of them)
Curves = Mapping[str, "Curve"]        # by the term of truearc.sim.physics.catalogue that takes it


# Chosen: a bend in the middle of a range; of the paper's launcher and MuJoCo's, errors are no wigglier
LENGTH = 0.4                          # of a smooth curve, as a share of its covariate's range
SHAPES = 4                            # of a smooth curve: places less than LENGTH apart, so that no bend is lost


class Curve(Struct, frozen=True, forbid_unknown_fields=True):
    """A curve as described above; `value` belongs to `at`, to `levels`, or to a constant and the shapes `over` ranges.
    """

    value: tuple[float, ...]
    otherwise: float
    covariate: str = ""
    at: tuple[float, ...] = ()
    levels: tuple[str, ...] = ()
    low: float = -np.inf
    high: float = np.inf
    over: dict[str, tuple[float, float]] = {}

    @property
    def points(self) -> Float[np.ndarray, " points"]:
        """The numbers [K + 1] in which it is linear: `value`, then `otherwise`."""
        return np.array([*self.value, self.otherwise])

    @property
    def keys(self) -> tuple[str, ...]:
        """Names of the points, as numbers."""
        return tuple(map(str, range(len(self.value) + 1)))

    @property
    def fitted(self) -> tuple[str, ...]:
        """Keys of the points that recordings determine; the mean of the recorded shots follows from them."""
        return self.keys[:-1] or self.keys

    def point(self, key: str) -> float:
        """Return a point; KeyError for an unknown key."""
        return float(dict(zip(self.keys, self.points, strict=True))[key])

    def moved(self, points: Mapping[str, float]) -> "Curve":
        """Return the curve with these points at other values."""
        now = [points.get(key, value) for key, value in zip(self.keys, self.points, strict=True)]
        return msgspec.structs.replace(self, value=tuple(map(float, now[:-1])), otherwise=float(now[-1]))

    def by(self, columns: Columns, n: int) -> Float[np.ndarray, "n points"]:
        """Return derivatives [n, K + 1] of its size by the points, at shots with these columns."""
        by = np.zeros((n, len(self.keys)))
        if self.over:
            by[:, 0] = 1.0
            for k, (name, ends) in enumerate(self.over.items()):
                x = np.asarray(columns.get(name, np.full(n, np.nan)), dtype=float)
                by[:, 1 + k * SHAPES:1 + (k + 1) * SHAPES] = smooth(x, *ends)
            return by
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
    """Return [n, K], from values at the knots to those of their natural cubic spline at x, straight beyond the outer
    knots."""
    spline = CubicSpline(knots, np.eye(len(knots)), bc_type="natural")
    inside = np.clip(x, knots[0], knots[-1])
    return np.asarray(spline(inside) + (x - inside)[:, None] * spline(inside, 1))


def smooth(x: Float[np.ndarray, " n"], low: float, high: float) -> Float[np.ndarray, "n shapes"]:
    """Return shapes of a Gaussian process of variance 1 and LENGTH over a range, less their mean over it; constant
    beyond it, 0 where x is unknown."""
    knots, whole = np.linspace(0.0, 1.0, SHAPES), np.linspace(0.0, 1.0, 101)

    def kernel(places: Float[np.ndarray, " m"]) -> Float[np.ndarray, "shapes m"]:
        return np.asarray(np.exp(-0.5 * ((knots[:, None] - places) / LENGTH)**2))

    root = np.linalg.cholesky(kernel(knots))
    shapes, mean = (np.linalg.solve(root, kernel(places)).T
                    for places in (np.clip((x - low) / (high - low), 0.0, 1.0), whole))
    return np.asarray(np.nan_to_num(shapes - mean.mean(0)))


def along(curves: Curves, circumstances: Circumstances, columns: Columns, n: int) -> Circumstances:
    """Return the circumstances of n shots with these columns, including the curves' sizes."""
    if not curves:
        return circumstances
    by = np.concatenate([curve.by(columns, n) for curve in curves.values()], axis=1)
    points = np.concatenate([curve.points for curve in curves.values()])
    return resized(circumstances._replace(curve_by=by), owners(curves), points)


def owners(curves: Curves) -> tuple[str, ...]:
    """Return the owner of each of all points, in the order of `Circumstances.curve_by`."""
    return tuple(term for term, curve in curves.items() for _ in curve.keys)


def resized(circumstances: Circumstances, whose: Sequence[str], points: Any) -> Circumstances:
    """Return circumstances with the curves' points at these values [K], or [n, K] for each shot; `whose`: the owners.
    Differentiable."""
    shares = circumstances.curve_by * points
    mine = {term: np.array([owner == term for owner in whose]) for term in whose}
    return circumstances._replace(**{term: shares[..., here].sum(-1) for term, here in mine.items()})


def before_the_shot(curves: Curves, rig: Rig, shots: Shots) -> Circumstances:
    """Return ordinary circumstances of configurations: curve sizes depend only on launch and distance columns."""
    if not curves:
        return ORDINARY
    return along(curves, ORDINARY, {**shots.numbers, **launch_state(rig, shots)}, len(shots))


def read_curves(path: str | Path, tables: Any) -> dict[str, Curve]:
    """Read the file's [curve.TERM] tables; InputError names file and key."""
    if not isinstance(tables, dict):
        raise InputError(f"{path}: curve: not one table a term, such as [curve.free_speed]")
    return {str(term): _read_curve(f"{path}: curve.{term}", table) for term, table in tables.items()}


def _read_curve(place: str, table: Any) -> Curve:
    try:
        curve = msgspec.convert(table, Curve)
    except msgspec.ValidationError as error:
        raise InputError(f"{place}: {reworded(str(error), table)}") from error
    if not np.isfinite((*curve.value, *curve.at, curve.otherwise)).all():
        raise InputError(f"{place}: a number in it is not finite")
    if curve.over and not (len(curve.value) == 1 + SHAPES * len(curve.over)
                           and all(low < high for low, high in curve.over.values())):
        raise InputError(f"{place}.over: not a rising range and {SHAPES} values for each covariate, beside a constant")
    if curve.covariate and len(curve.value) != len(curve.levels or curve.at):
        raise InputError(f"{place}.value: {len(curve.value)} of them for {len(curve.levels or curve.at)} places")
    if curve.at and (len(curve.at) < 2 or not (np.diff(curve.at) > 0.0).all()):
        raise InputError(f"{place}.at: not two or more numbers in rising order")
    return curve


def write_curve(curve: Curve) -> dict[str, Any]:
    """Return the table that reads back as this curve."""
    usual = Curve((), 0.0)
    said = {key: value for key, value in msgspec.structs.asdict(curve).items()
            if key in ("value", "otherwise") or value != getattr(usual, key)}
    return {key: list(value) if isinstance(value, tuple) else value for key, value in said.items()}


SCATTERS = ("speed", "elevation_deg")
SCATTER = "scatter"
BALLS, BALL_SPEED = "balls", "speed"


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
    one per row of `covariance` [p, p], which is on the parameters' own scales (module docstring); all others are exact.
    curves: sizes of unexplained effects, by their terms of truearc.sim.physics.catalogue in `coefficients`. catalogue:
    catalogue of the terms that the coefficients name. provenance: origin of the belief, in plain values that a file
    keeps; of these, only forecast_error (truearc.sim.infer.track_forecast) is used in computations. balls: {"speed" or
    "term.parameter": standard deviation between balls}, of the speed as a share; empty where recordings did not tell
    balls apart.
    """

    coefficients: Coefficients
    scatter: dict[str, float]
    names: tuple[str, ...]
    covariance: Float[np.ndarray, "p p"]
    curves: dict[str, Curve] = field(default_factory=dict)
    catalogue: Catalogue = field(default_factory=terms.catalogue)
    provenance: dict[str, Any] = field(default_factory=dict)
    balls: dict[str, float] = field(default_factory=dict)

    def other_rig(self, rig: Rig) -> str:
        """Describe how a rig differs from the one that the belief was fitted to; "" if it does not or is unknown."""
        fitted = self.provenance.get("rig")
        if not isinstance(fitted, Mapping):
            return ""
        here = launcher_of(rig)
        differ = [f"{key} is {here.get(key, 'absent')}, was {fitted.get(key, 'absent')}"
                  for key in dict.fromkeys((*fitted, *here)) if here.get(key) != fitted.get(key)]
        return f"fitted to another rig: {', '.join(differ)}" if differ else ""

    def values(self) -> Float[np.ndarray, " p"]:
        """Return the named parameters [p] on their scales, the mean that belongs to `covariance`."""
        return np.array([float(to_scale(scale_of(name, self.catalogue), self.value(name))) for name in self.names])

    def value(self, name: str) -> float:
        """Return one parameter, given as "term.parameter" or "scatter.x", in its own unit."""
        table, _, key = name.partition(".")
        if table == CURVE:
            term, _, point = key.partition(".")
            return self.curves[term].point(point)
        return self.scatter[key] if table == SCATTER else self.coefficients[table][key]

    def has(self, name: str) -> bool:
        """Whether the belief contains the number."""
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
        if self.balls:
            table[BALLS] = dict(self.balls)
        text = make_toml({"schema": SCHEMA, **table, "provenance": dict(self.provenance)})
        _read(parse_table(text, str(path)), path, self.catalogue)
        save_whole(path, text.encode())

    def lines(self) -> list[str]:
        """Return a line per number: its value, unit, and standard deviation (a factor if its scale is the log); and one
        for each error of the model that it leaves room for."""
        doubt = dict(zip(self.names, np.sqrt(np.diag(self.covariance)), strict=True))
        rooms = {term: curve for term, curve in self.curves.items() if curve.over}
        names = [f"{term}.{key}" for term, values in (*self.coefficients.items(), (SCATTER, self.scatter))
                 if term not in rooms for key in values]
        return [*(self._line(name, doubt.get(name)) for name in names),
                *(self._room(term, curve, doubt.get(f"{CURVE}.{term}.0", 0.0)) for term, curve in rooms.items())]

    def _room(self, term: str, curve: Curve, sd: float) -> str:
        unit = terms.find_nameless(term).amplitude.unit
        return (f"{term:28s} room for errors of the model: ± {sd:.2g} {'of it' if unit == '1' else unit}, and smooth "
                f"over {', '.join(curve.over)}")

    def _line(self, name: str, sd: float | None) -> str:
        scale = scale_of(name, self.catalogue)
        known = "" if sd is None else f" × or / {np.exp(sd):.3g}" if scale == LOG else (
            f" ± {sd:.2g}" if scale == LINEAR else f" ± {sd:.2g} on its {scale} scale")
        scattered = "deg" if name.endswith("_deg") else "1"
        unit = scattered if name.startswith(SCATTER + ".") else terms.find_parameter(name, self.catalogue).unit
        return f"{name:28s} {self.value(name):.4g}{known}{'' if unit == '1' else f' {unit}'}"


def point_belief(coefficients: Mapping[str, Mapping[str, float]], scatter: Mapping[str, float] | None = None,
                 among: Catalogue | None = None) -> Belief:
    """Return a belief without uncertainty, such as the grid's pair."""
    return Belief({name: dict(values) for name, values in coefficients.items()}, dict(scatter or {}), (),
                  np.zeros((0, 0)), catalogue=terms.as_catalogue(among))


def scale_of(name: str, among: Catalogue | None = None) -> str:
    """Return the scale of a parameter by name; a parameter that is known, not fitted, has the linear one."""
    if name.startswith(SCATTER + "."):
        return LOG
    prior = terms.find_parameter(name, among).prior
    return prior.scale if prior is not None else LINEAR


def replace_values(belief: Belief, numbers: Float[np.ndarray, " p"]) -> Belief:
    """Return a point belief whose named parameters have these values, given on their scales [p]."""
    coefficients = {name: dict(values) for name, values in belief.coefficients.items()}
    scatter, points = dict(belief.scatter), dict[str, float]()
    for name, number in zip(belief.names, numbers, strict=True):
        table, _, key = name.partition(".")
        place = {SCATTER: scatter, CURVE: points, **coefficients}[table]
        place[key] = float(from_scale(scale_of(name, belief.catalogue), number))
    return replace(point_belief(coefficients, scatter, belief.catalogue), curves=moved_curves(belief.curves, points))


def moved_curves(curves: Mapping[str, Curve], points: Mapping[str, float]) -> dict[str, Curve]:
    """Return the curves with these points {"free_speed.0": value} at other values."""
    return {term: curve.moved({key.removeprefix(term + "."): value for key, value in points.items()
                               if key.startswith(term + ".")}) for term, curve in curves.items()}


def draw(belief: Belief, n: int, rng: np.random.Generator) -> list[Belief]:
    """Draw `n` point beliefs, normal on the parameters' scales with the belief's covariance; without one, n copies."""
    if not belief.names:
        return [replace(point_belief(belief.coefficients, belief.scatter, belief.catalogue), curves=belief.curves)] * n
    drawn = rng.multivariate_normal(belief.values(), belief.covariance, size=n, method="eigh")
    return [replace_values(belief, numbers) for numbers in drawn]


def as_table(belief: Belief) -> dict[str, Any]:
    """Return plain values, as in JSON, from which `from_table` makes the same belief."""
    return {"coefficients": belief.coefficients, "scatter": belief.scatter, "names": list(belief.names),
            "covariance": np.asarray(belief.covariance, float).tolist(),
            CURVE: {term: write_curve(curve) for term, curve in belief.curves.items()}, BALLS: belief.balls}


def from_table(table: Mapping[str, Any], name: str) -> Belief:
    """Invert `as_table`; `name` is for messages. KeyError, ValueError, InputError: not such a table."""
    names = tuple(map(str, table["names"]))
    return Belief(table["coefficients"], table["scatter"], names,
                  np.array(table["covariance"], float).reshape(len(names), len(names)),
                  read_curves(name, table.get(CURVE, {})), balls=dict(table.get(BALLS, {})))


def load_belief(path: str | Path, among: Catalogue | None = None) -> Belief:
    """Read a coefficients.toml; a missing [scatter] or [covariance] is empty.

    among: the catalogue of permitted terms; by default truearc.sim.physics.catalogue.catalogue().

    InputError names the file and key of a value that is unknown, not a number, out of its range, or not a covariance.
    """
    return _read(load_table(path), path, among)


def _read(table: dict[str, Any], path: str | Path, among: Catalogue | None) -> Belief:
    coefficients = coefficients_in(table, path, among)
    provenance = table.get("provenance", {})
    if not isinstance(provenance, dict):
        raise InputError(f"{path}: provenance is not a table")
    scatter = _spreads(path, SCATTER, table.get(SCATTER, {}), SCATTERS)
    fitted = [f"{term}.{key}" for term, values in coefficients.items() for key in values]
    names, covariance = _covariance(path, table.get("covariance", {}))
    curves = read_curves(path, table.get(CURVE, {}))
    taking = [term.name for term in NAMELESS if term.name in coefficients]
    for term in curves:
        if term not in taking:
            raise InputError(f"{path}: curve.{term}: no term takes it, such as [free_speed] takes [curve.free_speed]")
    for term in taking:
        if term not in curves:
            raise InputError(f"{path}: {term}: has no [curve.{term}] to say how large it is")
    belief = Belief(coefficients, scatter, names, covariance, curves, terms.as_catalogue(among), provenance,
                    _spreads(path, BALLS, table.get(BALLS, {}), [BALL_SPEED, *fitted]))
    for name in names:
        _check(path, name, belief)
    return belief


def _spreads(path: str | Path, name: str, table: Any, known: Iterable[str]) -> dict[str, float]:
    """The numbers above 0 of a table [scatter] or [balls], whose keys are among the known."""
    if not isinstance(table, dict):
        raise InputError(f"{path}: {name} is not a table")
    for key, value in table.items():
        if key not in known:
            raise InputError(f"{path}: {name}.{key}: there is no such number ({', '.join(known)})")
        if isinstance(value, bool) or not isinstance(value, int | float) or not (0.0 < value < np.inf):
            raise InputError(f"{path}: {name}.{key}: {value!r} is not a number above 0")
    return {key: float(value) for key, value in table.items()}


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
