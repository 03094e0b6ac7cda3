"""What residuals might depend on: every numeric column, what can be derived from it, and every text column."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.infer.likelihood.data import WORN, Each, number_columns
from truearc.sim.infer.likelihood.score_table import Array
from truearc.sim.physics.simulate import LAUNCH_STATE

# Results of a shot, not its settings.
RESULTS = ("miss_height_m", "outcome", "side")
SAME = 0.98                           # |correlation| from which two columns are one covariate with two names
FEWEST = 8                            # known values: fewer say little
MOST_LEVELS = 20
# Columns behind what a term follows from shot to shot, the fittest first.
FOLLOWED = {"battery": ("battery_v",), "since_last_shot_s": ("since_last_shot_s",), "density": ("temperature_c",),
            "closing_speed_m_s": ("robot_speed_m_s",), "hood_change": ("hood_change",), "droop": ("wheel_dip",),
            "age": (WORN, "t_s")}
IN_FLIGHT = ("speed_in_flight_m_s", "time_in_flight_s")      # what forces vary with inside one flight


@dataclass(frozen=True)
class Covariate:
    """A number a shot, nan where unknown, under each of its names: columns so alike that the data cannot part them."""

    columns: tuple[tuple[str, Each], ...]

    @property
    def name(self) -> str:
        return self.columns[0][0]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(name for name, _ in self.columns)

    @property
    def values(self) -> Each:
        return self.columns[0][1]

    def led_by_launch(self) -> "Covariate":
        """The same under the ball's speed or spin, if just one of them is among the names: forces know no wheels."""
        states = [name for name in LAUNCH_STATE if name in self.names]
        return self.led_by(states) if len(states) == 1 else self

    def led_by(self, names: Collection[str]) -> "Covariate":
        """The same under the first of its names that is among these, if any."""
        return Covariate(tuple(sorted(self.columns, key=lambda column: column[0] not in names)))


@dataclass(frozen=True)
class Factor:
    """A text column: `codes` [n] index `levels`, -1 where empty."""

    name: str
    levels: tuple[str, ...]
    codes: Int[Array, " n"]


@dataclass(frozen=True)
class CovariatePair:
    """Two covariates that something may depend on together: `place` [2, n] in standard deviations, 0 where unknown."""

    first: Covariate
    second: Covariate
    place: Float[Array, "2 n"]

    @property
    def name(self) -> str:
        return f"{self.first.name} x {self.second.name}"


def gather_covariates(dataset: Dataset) -> tuple[Covariate, ...]:
    """Columns, derived launch state, time and order, and first value and dip of each telemetry signal.

    Columns that run alike (|correlation| >= 0.98) are one covariate; constant ones are left out.
    """
    found: list[Covariate] = []
    for name, values in number_columns(dataset).items():
        if name in RESULTS or not varies(values):
            continue
        twin = next((k for k, other in enumerate(found) if _alike(other.values, values)), None)
        if twin is None:
            found.append(Covariate(((name, values),)))
        else:
            found[twin] = Covariate((*found[twin].columns, (name, values)))
    return tuple(covariate.led_by_launch() for covariate in found)


def gather_factors(shots: Shots) -> tuple[Factor, ...]:
    """Text columns with between two and twenty levels."""
    found = []
    for name in shots.texts:
        levels = tuple(sorted({text for text in shots.text(name) if text}))
        if name not in RESULTS and 2 <= len(levels) <= MOST_LEVELS:
            codes = np.array([levels.index(text) if text else -1 for text in shots.text(name)])
            found.append(Factor(name, levels, codes))
    return tuple(found)


def followed_column(follows: str, covariates: Iterable[Covariate]) -> str | None:
    """The column behind what a term follows from shot to shot; None for what goes on inside a flight."""
    names = {name for covariate in covariates for name in covariate.names}
    return next((name for name in FOLLOWED.get(follows, ()) if name in names), None)


def carried_by(covariate: Covariate, factors: tuple[Factor, ...]) -> tuple[str, ...]:
    """Factors in each of whose levels the covariate stays the same: any of them could stand in its place."""
    values, held = covariate.values, []
    for factor in factors:
        groups = [values[(factor.codes == code) & np.isfinite(values)] for code in range(len(factor.levels))]
        if all(len(group) == 0 or not np.ptp(group) > 1e-6 * np.nanmax(np.abs(values)) for group in groups):
            held.append(factor.name)
    return tuple(held)


def smooth_shapes(values: Each) -> Float[Array, "n shapes"]:
    """Natural cubic spline basis [n, 4] on the quantiles of `values`: straight, and three bends; unknown = 0."""
    known = np.isfinite(values)
    middle, width = values[known].mean(), values[known].std()
    scaled = np.where(known, (values - middle) / width, 0.0)
    knots = (_quantiles(values[known]) - middle) / width
    columns = [scaled]
    if len(knots) >= 4:
        last = _ramp(scaled, knots[-2], knots)
        columns += [_ramp(scaled, knot, knots) - last for knot in knots[:-2]]
    basis = np.where(known[:, None], np.stack(columns, axis=1), 0.0)
    unit: Array = basis / np.maximum(basis.std(0), 1e-12)
    return unit


def spline_knots(values: Each) -> Float[Array, " knots"]:
    """Where the basis of `smooth_shapes` bends, ends included; two places where it does not."""
    knots = _quantiles(values)
    return knots if len(knots) >= 4 else np.array([values.min(), values.max()])


def _quantiles(values: Each) -> Float[Array, " knots"]:
    return np.unique(np.quantile(values, (0.02, 0.27, 0.5, 0.73, 0.98)))


def _ramp(scaled: Each, knot: float, knots: Float[Array, " knots"]) -> Each:
    """Truncated cubes that leave the spline straight beyond the last knot."""
    ramp: Array = (np.maximum(scaled - knot, 0.0)**3 - np.maximum(scaled - knots[-1], 0.0)**3) / (knots[-1] - knot)
    return ramp


def varies(values: Each) -> bool:
    known = values[np.isfinite(values)]
    return len(known) >= FEWEST and bool(np.ptp(known) > 1e-9 * (1e-9 + np.abs(known).max()))


def _alike(a: Each, b: Each) -> bool:
    both = np.isfinite(a) & np.isfinite(b)
    mostly = both.sum() >= 0.9 * max(np.isfinite(a).sum(), np.isfinite(b).sum())
    if not (mostly and varies(a[both]) and varies(b[both])):
        return False
    return bool(abs(np.corrcoef(a[both], b[both])[0, 1]) >= SAME)
