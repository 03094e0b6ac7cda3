"""How a test weighs shots: by what may depend on one covariate, on a group, on two covariates together.

A shape is made from the session that is asked, in whose units and about whose middle it is; it can be laid over the
shots of another session, which is looked at the same way.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float, Shaped

from truearc.sim.discover.detect.covariates import Covariate, CovariatePair, Factor, varies
from truearc.sim.infer.likelihood.score_table import Array

FEWEST = 8                            # shots on each side of a step, and in a group: the signs of fewer say little
STEPS = 5
STEP = "step at "                     # followed by where
WAVES = 48                            # over planes of two covariates drawn at random
WAVE_LENGTH = 1.5                     # standard deviations of a covariate to a radian
FARTHEST = 2.5                        # standard deviations beyond which a covariate of a pair counts as no further out


@dataclass(frozen=True)
class Look:
    """A session's n shots. `at`: what they are by a covariate, numbers [n], nan where unknown; or by a factor, codes
    [n] of its levels, -1 where unknown."""

    n: int
    at: Callable[[Covariate | Factor], Shaped[Array, " n"]]


Each = Float[Array, " n"]             # a number of each shot
Law = Callable[[Array], Each]         # by the covariate [n], or the place [2, n] of two


@dataclass(frozen=True)
class WeightFunction:
    """One way of weighing. what None: every shot alike. `weigh`: weights [n] of the shots of a session so looked at."""

    what: Covariate | Factor | CovariatePair | None
    name: str
    weigh: Callable[[Look], Each]


def _ones(look: Look) -> Each:
    return np.ones(look.n)


SAME = WeightFunction(None, "same", _ones)


def number_shapes(covariate: Covariate, look: Look) -> list[WeightFunction]:
    """Straight, bent, steps, proportional. All but the last are centred; a shot whose covariate is unknown weighs
    nothing."""
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
        largest = np.abs(values[known]).max()
        laws.append(("proportional", partial(_straight, 0.0, largest)))
    return [WeightFunction(covariate, name, partial(_of_number, covariate, law)) for name, law in laws]


def group_shapes(factor: Factor, look: Look) -> list[WeightFunction]:
    """Each level of a factor with enough shots against the rest, centred."""
    codes = look.at(factor)
    found = []
    for code, level in enumerate(factor.levels):
        inside = codes == code
        if FEWEST <= inside.sum() <= (codes >= 0).sum() - FEWEST:
            found.append(WeightFunction(factor, level, partial(_of_group, factor, code, inside[codes >= 0].mean())))
    return found


def pair_shapes(covariates: Sequence[Covariate], look: Look, seed: int) -> list[WeightFunction]:
    """Over the plane of every two covariates, centred: their product, and over some planes a random wave (random
    Fourier features of a Gaussian kernel), so that whatever two of them do together leaves a trace."""
    placed = [(one, _place_in(look.at(one))) for one in covariates if varies(look.at(one))]
    pairs = [_Plane(*first, *second) for first, second in itertools.combinations(placed, 2)]
    shapes = [pair.shape("product", look, _product) for pair in pairs]
    rng = np.random.default_rng(seed)
    for pair in [pairs[k] for k in rng.integers(0, len(pairs), WAVES)] if pairs else ():
        turn, phase = rng.normal(size=2) / WAVE_LENGTH, rng.uniform(0.0, 2.0 * np.pi)
        shapes.append(pair.shape("wave", look, partial(_wave, turn, phase)))
    return shapes


def weights_of(shapes: Sequence[WeightFunction], look: Look) -> Float[Array, "n q"]:
    """Weights [n, q] of the shots so looked at."""
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
    product: Array = place[0] * place[1]
    return product


def _wave(turn: Float[Array, "2"], phase: float, place: Float[Array, "2 n"]) -> Each:
    wave: Array = np.sqrt(2.0) * np.cos(turn @ place + phase)
    return wave


def _place_in(values: Each) -> Law:
    """In standard deviations from the mean, no farther than FARTHEST; unknown = 0."""
    middle, width = np.nanmean(values), np.nanstd(values)
    return partial(_clipped, middle, width)


def _clipped(middle: float, width: float, x: Each) -> Each:
    return np.nan_to_num(np.clip((x - middle) / width, -FARTHEST, FARTHEST))


def _cuts(values: Each) -> list[float]:
    """Thresholds that leave enough shots on each side, at even quantiles, none splitting as another does."""
    ordered = np.unique(values)
    if len(ordered) < 3:
        return []                     # straight says it already
    middles = (ordered[1:] + ordered[:-1]) / 2.0
    wanted = np.quantile(values, np.arange(1, STEPS + 1) / (STEPS + 1.0))
    cuts = sorted({float(middles[np.abs(middles - want).argmin()]) for want in wanted})
    return [cut for cut in cuts if FEWEST <= (values > cut).sum() <= len(values) - FEWEST]
