"""The covariates that residuals may depend on (numeric, derived and text columns), and weight functions over them.

A test weights shots by a shape, which is a function of one covariate, of a group or of two covariates together. A shape
is scaled and centred on the session under test, and can also be evaluated on the shots of another session.
"""

import itertools
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float, Int, Shaped

from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.infer.likelihood.data import WORN, Each, number_columns
from truearc.sim.infer.likelihood.score_table import Array
from truearc.sim.physics.simulate import LAUNCH_STATE

# Results of a shot, not its settings.
RESULTS = ("miss_height_m", "outcome", "side")
# Chosen: only 4 % of either's variance is its own
SAME_CORRELATION = 0.98               # |correlation| from which two columns are one covariate with two names
# Derived: of values, shots on a side, signs; with 7 signs no p is below 2 / 2^7 = 1.6 %
FEWEST = 8
MOST_LEVELS = 20                      # chosen: more are names of single shots, not of kinds
# Columns behind what a term follows from shot to shot, the fittest first.
FOLLOWED = {"battery": ("battery_v",), "since_last_shot_s": ("since_last_shot_s",), "density": ("temperature_c",),
            "closing_speed_m_s": ("robot_speed_m_s",), "hood_change": ("hood_change",), "droop": ("wheel_dip",),
            "age": (WORN, "t_s")}
IN_FLIGHT = ("speed_in_flight_m_s", "time_in_flight_s")      # what forces vary with inside one flight


@dataclass(frozen=True)
class Covariate:
    """A number per shot, nan where unknown, under each of its names: columns too similar for the data to separate."""

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
        """Return the same under the ball's speed or spin, if just one is among the names: forces do not depend on
        wheels."""
        states = [name for name in LAUNCH_STATE if name in self.names]
        return self.led_by(states) if len(states) == 1 else self

    def led_by(self, names: Collection[str]) -> "Covariate":
        """Return the same under the first of its names that is among these, if any."""
        return Covariate(tuple(sorted(self.columns, key=lambda column: column[0] not in names)))


@dataclass(frozen=True)
class Factor:
    """A text column: `codes` [n] index `levels`, -1 where empty."""

    name: str
    levels: tuple[str, ...]
    codes: Int[Array, " n"]


@dataclass(frozen=True)
class CovariatePair:
    """Two covariates with a joint dependence: `place` [2, n] in standard deviations, 0 where unknown."""

    first: Covariate
    second: Covariate
    place: Float[Array, "2 n"]

    @property
    def name(self) -> str:
        return f"{self.first.name} x {self.second.name}"


def gather_covariates(dataset: Dataset) -> tuple[Covariate, ...]:
    """Return columns, derived launch state, time and order, and first value and dip of each telemetry signal.

    Columns that vary alike (|correlation| >= 0.98) are one covariate; constant ones are omitted.
    """
    columns = {name: values for name, values in number_columns(dataset).items() if name not in RESULTS}
    return tuple(covariate.led_by_launch() for covariate in covariates_among(columns))


def covariates_among(columns: Mapping[str, Each]) -> tuple[Covariate, ...]:
    """Return columns as `gather_covariates` does."""
    found: list[Covariate] = []
    for name, values in columns.items():
        if not varies(values):
            continue
        twin = next((k for k, other in enumerate(found) if _alike(other.values, values)), None)
        if twin is None:
            found.append(Covariate(((name, values),)))
        else:
            found[twin] = Covariate((*found[twin].columns, (name, values)))
    return tuple(found)


def gather_factors(shots: Shots) -> tuple[Factor, ...]:
    """Return text columns with between two and twenty levels."""
    return factors_among({name: shots.text(name) for name in shots.texts if name not in RESULTS})


def factors_among(columns: Mapping[str, Sequence[str]]) -> tuple[Factor, ...]:
    """Return columns as `gather_factors` does."""
    found = []
    for name, texts in columns.items():
        levels = tuple(sorted({text for text in texts if text}))
        if 2 <= len(levels) <= MOST_LEVELS:
            found.append(Factor(name, levels, np.array([levels.index(text) if text else -1 for text in texts])))
    return tuple(found)


def followed_column(follows: str, covariates: Iterable[Covariate]) -> str | None:
    """Return the column that a term follows from shot to shot; None for effects inside a flight."""
    names = {name for covariate in covariates for name in covariate.names}
    return next((name for name in FOLLOWED.get(follows, ()) if name in names), None)


def carried_by(covariate: Covariate, factors: tuple[Factor, ...]) -> tuple[str, ...]:
    """Return the factors within each of whose levels the covariate is constant: any of them could replace it."""
    values, held = covariate.values, []
    for factor in factors:
        groups = [values[(factor.codes == code) & np.isfinite(values)] for code in range(len(factor.levels))]
        if all(len(group) == 0 or not np.ptp(group) > 1e-6 * np.nanmax(np.abs(values)) for group in groups):
            held.append(factor.name)
    return tuple(held)


def smooth_shapes(values: Each) -> Float[Array, "n shapes"]:
    """Return a natural cubic spline basis [n, 4] on the quantiles of `values`: straight, and three bends; unknown =
    0."""
    known = np.isfinite(values)
    middle, width = values[known].mean(), values[known].std()
    scaled = np.where(known, (values - middle) / width, 0.0)
    knots = (_quantiles(values[known]) - middle) / width
    columns = [scaled]
    if len(knots) >= 4:
        last = _ramp(scaled, knots[-2], knots)
        columns += [_ramp(scaled, knot, knots) - last for knot in knots[:-2]]
    basis = np.where(known[:, None], np.stack(columns, axis=1), 0.0)
    return np.asarray(basis / np.maximum(basis.std(0), 1e-12))


def spline_knots(values: Each) -> Float[Array, " knots"]:
    """Return the knots of `smooth_shapes`, ends included; two places if it has none."""
    knots = _quantiles(values)
    return knots if len(knots) >= 4 else np.array([values.min(), values.max()])


def _quantiles(values: Each) -> Float[Array, " knots"]:
    # near those of Harrell (2015, section 2.4.6) for five knots, the outer ones farther out: lines begin at the ends
    return np.unique(np.quantile(values, (0.02, 0.27, 0.5, 0.73, 0.98)))


def _ramp(scaled: Each, knot: float, knots: Float[Array, " knots"]) -> Each:
    """Truncated cubes that leave the spline straight beyond the last knot."""
    return np.asarray((np.maximum(scaled - knot, 0.0)**3 - np.maximum(scaled - knots[-1], 0.0)**3) / (knots[-1] - knot))


def varies(values: Each) -> bool:
    known = values[np.isfinite(values)]
    return len(known) >= FEWEST and bool(np.ptp(known) > 1e-9 * (1e-9 + np.abs(known).max()))


def _alike(a: Each, b: Each) -> bool:
    both = np.isfinite(a) & np.isfinite(b)
    # chosen: a tenth may be unknown in one of them
    mostly = both.sum() >= 0.9 * max(np.isfinite(a).sum(), np.isfinite(b).sum())
    if not (mostly and varies(a[both]) and varies(b[both])):
        return False
    return bool(abs(np.corrcoef(a[both], b[both])[0, 1]) >= SAME_CORRELATION)


CUTS = 5                              # chosen: sixths of the shots
STEP = "step at "                     # followed by where
# Random Fourier features (Rahimi and Recht 2007); more share out the allowance more thinly
WAVES = 48                            # over planes of two covariates drawn at random
# Chosen: half a period spans WIDEST_PLACE to either side
WAVE_LENGTH = 1.5                     # standard deviations of a covariate to a radian
# Derived: 1 % of normal covariates are beyond
WIDEST_PLACE = 2.5                    # standard deviations beyond which a covariate of a pair counts as no further out


@dataclass(frozen=True)
class Look:
    """A session's n shots. `at`: their values of a covariate [n], nan where unknown, or their codes of a factor's
    levels [n], -1 where unknown."""

    n: int
    at: Callable[[Covariate | Factor], Shaped[Array, " n"]]


Law = Callable[[Array], Each]         # by the covariate [n], or the place [2, n] of two


@dataclass(frozen=True)
class WeightFunction:
    """One way of weighting. what None: every shot alike. `weigh`: weights [n] of the shots of a Look."""

    what: Covariate | Factor | CovariatePair | None
    name: str
    weigh: Callable[[Look], Each]


def _ones(look: Look) -> Each:
    return np.ones(look.n)


SAME_SHAPE = WeightFunction(None, "same", _ones)


def number_shapes(covariate: Covariate, look: Look) -> list[WeightFunction]:
    """Return straight, bent, step and proportional shapes.

    All but the last are centred; a shot whose covariate is unknown has weight 0.
    """
    values = look.at(covariate)
    known = np.isfinite(values)
    if known.sum() < FEWEST or not varies(values):
        return []
    middle, width = values[known].mean(), values[known].std()
    scaled = (values - middle) / width
    skew = np.mean(scaled[known]**3)
    laws: list[tuple[str, Law]] = [("straight", partial(_straight, middle, width))]
    if len(np.unique(values[known])) >= 3:
        laws.append(("bent", partial(_bent, middle, width, skew)))
    laws += [(f"{STEP}{cut:.4g}", partial(_step, cut, np.mean(values[known] > cut))) for cut in _cuts(values[known])]
    if {"exit_spin_rev_s", "exit_speed_m_s"} & set(covariate.names):
        laws.append(("proportional", partial(_straight, 0.0, np.abs(values[known]).max())))
    return [WeightFunction(covariate, name, partial(_of_number, covariate, law)) for name, law in laws]


def group_shapes(factor: Factor, look: Look) -> list[WeightFunction]:
    """Contrast each level of a factor that has enough shots with the rest, centred."""
    codes = look.at(factor)
    found = []
    for code, level in enumerate(factor.levels):
        inside = codes == code
        if FEWEST <= inside.sum() <= (codes >= 0).sum() - FEWEST:
            found.append(WeightFunction(factor, level, partial(_of_group, factor, code, inside[codes >= 0].mean())))
    return found


def pair_shapes(covariates: Sequence[Covariate], look: Look) -> list[WeightFunction]:
    """Return centred shapes over the plane of every two covariates: their product and, over some planes, a random wave
    (random Fourier features of a Gaussian kernel), so that any joint effect leaves a trace. The waves are always the
    same: of few shots, one in hundreds of waves may be all that can be tested."""
    placed = [(one, _place_in(look.at(one))) for one in covariates if varies(look.at(one))]
    pairs = [_Plane(*first, *second) for first, second in itertools.combinations(placed, 2)]
    shapes = [pair.shape("product", look, _product) for pair in pairs]
    rng = np.random.default_rng(0)
    for pair in [pairs[k] for k in rng.integers(0, len(pairs), WAVES)] if pairs else ():
        turn, phase = rng.normal(size=2) / WAVE_LENGTH, rng.uniform(0.0, 2.0 * np.pi)
        shapes.append(pair.shape("wave", look, partial(_wave, turn, phase)))
    return shapes


def weights_of(shapes: Sequence[WeightFunction], look: Look) -> Float[Array, "n q"]:
    """Return weights [n, q] of the shots of a Look."""
    return np.stack([shape.weigh(look) for shape in shapes], axis=1)


@dataclass(frozen=True)
class _Plane:
    """Of two covariates, each with the way to its place in it."""

    first: Covariate
    across: Law
    second: Covariate
    up: Law

    def place(self, look: Look) -> Float[Array, "2 n"]:
        """[2, n] in standard deviations."""
        return np.stack([self.across(look.at(self.first)), self.up(look.at(self.second))])

    def shape(self, name: str, look: Look, law: Law) -> WeightFunction:
        """By a law of the place, centred over the shots of the session that is asked."""
        place = self.place(look)
        what = CovariatePair(self.first, self.second, place)
        return WeightFunction(what, name, partial(_of_pair, self, law, law(place).mean()))


def _of_pair(plane: _Plane, law: Law, middle: float, look: Look) -> Each:
    return law(plane.place(look)) - middle


def _of_number(covariate: Covariate, law: Law, look: Look) -> Each:
    values = look.at(covariate)
    return np.where(np.isfinite(values), law(values), 0.0)


def _of_group(factor: Factor, code: int, share: float, look: Look) -> Each:
    codes = look.at(factor)
    return np.where(codes >= 0, (codes == code) - share, 0.0)


def _straight(middle: float, width: float, x: Each) -> Each:
    return (x - middle) / width


def _bent(middle: float, width: float, skew: float, x: Each) -> Each:
    return ((x - middle) / width)**2 - 1.0 - (x - middle) / width * skew


def _step(cut: float, share: float, x: Each) -> Each:
    return (x > cut) - share


def _product(place: Float[Array, "2 n"]) -> Each:
    return np.asarray(place[0] * place[1])


def _wave(turn: Float[Array, "2"], phase: float, place: Float[Array, "2 n"]) -> Each:
    return np.asarray(np.sqrt(2.0) * np.cos(turn @ place + phase))


def _place_in(values: Each) -> Law:
    """In standard deviations from the mean, no farther than WIDEST_PLACE; unknown = 0."""
    middle, width = np.nanmean(values), np.nanstd(values)
    return partial(_clipped, middle, width)


def _clipped(middle: float, width: float, x: Each) -> Each:
    return np.nan_to_num(np.clip((x - middle) / width, -WIDEST_PLACE, WIDEST_PLACE))


def _cuts(values: Each) -> list[float]:
    """Thresholds that leave enough shots on each side, at even quantiles, none splitting as another does."""
    ordered = np.unique(values)
    if len(ordered) < 3:
        return []                     # straight says it already
    middles = (ordered[1:] + ordered[:-1]) / 2.0
    wanted = np.quantile(values, np.arange(1, CUTS + 1) / (CUTS + 1.0))
    cuts = sorted({float(middles[np.abs(middles - want).argmin()]) for want in wanted})
    return [cut for cut in cuts if FEWEST <= (values > cut).sum() <= len(values) - FEWEST]
