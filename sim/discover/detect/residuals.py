"""Residuals of the shots before and after an effect is put into the simulation, for the report's pictures.

Many shots' residual in one free number (launch speed, a push in flight) is the sum of their scores over the sum of
their informations; in the height at the target it is the shift under which their outcomes are likeliest.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from truearc.sim.discover.detect.covariates import Covariate, Factor, followed_column
from truearc.sim.discover.detect.localization import Place
from truearc.sim.discover.detect.test_battery import Asked
from truearc.sim.discover.report.effect_wording import scale_of
from truearc.sim.discover.select.name_effects import Step
from truearc.sim.discover.select.refit import promote
from truearc.sim.infer.fit import BaselineFit
from truearc.sim.infer.likelihood import observations as outcomes
from truearc.sim.infer.likelihood.score_table import Array, PlaneScores, ScoreTable

HEIGHT = "height at the target"
MOST_BINS, BIN_SHOTS = 8, 6
MOST_GROUPS = 3
FEWEST = 3                            # shots of a bin
SHIFTS, MOST_SPREADS = 201, 5.0       # of heights that are tried, as far as this number of spreads of one shot
AT_STAGE = 3.0                        # weight of numbers of the stage where it happens
Along = Covariate | Factor


@dataclass(frozen=True)
class LinearResiduals:
    """Score and information [n] of a column."""

    score: Float[Array, " n"]
    information: Float[Array, " n"]

    def estimate(self, chosen: Bool[Array, " n"]) -> tuple[float, float]:
        """(residual, standard error) of the chosen shots [n]: by information, or by how these differ if that is more.

        nan where they have no information.
        """
        score, information = self.score[chosen], self.information[chosen]
        if len(score) < FEWEST or not information.sum() > 0.0:
            return np.nan, np.nan
        value = score.sum() / information.sum()
        spread = max(float(((score - information * value)**2).sum()), float(information.sum()))
        return float(value), float(np.sqrt(spread) / information.sum())


@dataclass(frozen=True)
class Heights:
    """Observed and expected heights at the plane, of the shots `rows` of n."""

    plane: PlaneScores
    shots: int

    def estimate(self, chosen: Bool[Array, " n"]) -> tuple[float, float]:
        """(common shift of heights in m, uphill from none, its standard error by the likelihood); nan: none to be had.

        A miss that may have been high or low has a second summit far off, which is implausible.
        """
        plane = self.plane
        mine = np.flatnonzero(chosen[plane.rows])
        if len(mine) < FEWEST:
            return np.nan, np.nan
        seen, mean_m, spread_m = plane.seen.take(mine), plane.mean_m[mine], plane.spread_m[mine]
        shifts = np.linspace(-1.0, 1.0, SHIFTS) * MOST_SPREADS * float(np.median(spread_m))
        value = np.array([outcomes.log_likelihood(seen, mean_m + shift, spread_m).sum() for shift in shifts])
        best = _uphill(value, SHIFTS // 2)
        low = best - int(np.argmax(value[best::-1] < value[best] - 0.5))
        high = best + int(np.argmax(value[best:] < value[best] - 0.5))
        if low == best or high == best:
            return np.nan, np.nan
        return float(shifts[best]), float((shifts[high] - shifts[low]) / 2.0)


def _uphill(value: Float[Array, " shifts"], start: int) -> int:
    """Index of the summit that one comes to from `start`."""
    here = start
    while True:
        near = range(max(here - 1, 0), min(here + 2, len(value)))
        best = max(near, key=lambda k: value[k])
        if value[best] <= value[here]:
            return here
        here = best


Part = LinearResiduals | Heights


@dataclass(frozen=True)
class Residual:
    """One number before and after; `factor` turns it into `unit` as people say it.

    column: of the evidence, None for the height at the target. stage: where such a change happens. after None: nothing
    was put in.
    """

    name: str
    column: int | None
    stage: str
    factor: float
    unit: str
    before: Part
    after: Part | None


@dataclass(frozen=True)
class Bins:
    """Where each shot [n] belongs (-1 nowhere), and the bins' middles [B]; labels of groups, else empty."""

    name: str
    index: Int[Array, " n"]
    middle: Float[Array, " B"]
    labels: tuple[str, ...] = ()


def evidence_after(step: Step) -> ScoreTable:
    """With the step's name fitted in, or with the free curve, each shot's from the other folds, where it has none."""
    if not step.unknown:
        return promote(step.fitted, step.refit).evidence
    if step.place is None:
        return step.fitted.evidence
    return corrected(step.fitted.evidence, step.place)


def corrected(evidence: ScoreTable, place: Place) -> ScoreTable:
    """The evidence after the place's free curve."""
    change = np.zeros_like(evidence.score)
    change[:, place.test.column] = place.correction.after[:, 0]
    change[:, evidence.first_shared:] = place.correction.after[:, 1:]
    return evidence.moved(change)


def residuals_of(before: ScoreTable, after: ScoreTable | None, tracked: bool) -> tuple[Residual, ...]:
    """The height at the target; with tracks also launch, distance and pushes throughout the flight."""
    found = []
    if before.plane is not None:
        later = None if after is None or after.plane is None else Heights(after.plane, len(after.rows))
        found.append(Residual(HEIGHT, None, "arrival", 100.0, "cm", Heights(before.plane, len(before.rows)), later))
    for k, column in enumerate(before.columns[:before.first_shared] if tracked else ()):
        # a wrong distance is seen in nothing but the height
        plain = column.kind == "free" and column.stage != "sensing" and not column.follows
        if plain and (before.info[:, k, k] > 0.0).any():
            factor, unit = scale_of(column.unit)
            found.append(Residual(column.name, k, column.stage, factor, unit.strip(), _linear(before, column.name),
                                  None if after is None else _linear(after, column.name)))
    return tuple(found)


def _linear(evidence: ScoreTable, name: str) -> LinearResiduals:
    k = evidence.index(name)
    return LinearResiduals(evidence.score[:, k], evidence.info[:, k, k])


def covariates_in(asked: Asked) -> tuple[Along, ...]:
    """Everything that tests were made along, by itself, each once."""
    found: dict[str, Along] = {}
    for test in asked.tests:
        if isinstance(test.what, Covariate | Factor):
            found.setdefault(test.what.name, test.what)
    return tuple(found.values())


def find_along(name: str | None, along: Sequence[Along]) -> Along | None:
    """The covariate or factor of that name, under any of its names."""
    for one in along:
        names = one.names if isinstance(one, Covariate) else (one.name,)
        if name in names:
            return one
    return None


def bins_of(along: Along, rows: Int[Array, " n"]) -> Bins:
    """Even shares of the shots, the distinct values of a covariate with few, the levels of a factor."""
    if isinstance(along, Factor):
        return Bins(along.name, along.codes[rows], np.arange(len(along.levels), dtype=float), along.levels)
    values = along.values[rows]
    known = np.isfinite(values)
    distinct = np.unique(values[known])
    if len(distinct) <= MOST_BINS:
        index = np.searchsorted(distinct, np.where(known, values, distinct[0]))
        return Bins(along.name, np.where(known, index, -1), distinct)
    count = int(np.clip(known.sum() // BIN_SHOTS, 2, MOST_BINS))
    edges = np.unique(np.quantile(values[known], np.linspace(0.0, 1.0, count + 1)))
    index = np.where(known, np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2), -1)
    middle = np.array([values[index == k].mean() if (index == k).any() else np.nan for k in range(len(edges) - 1)])
    return Bins(along.name, index, middle)


def binned(part: Part, bins: Bins) -> tuple[Float[Array, " B"], Float[Array, " B"]]:
    """(residual, standard error) [B]; nan where the shots of a bin have no information on it."""
    found = np.array([part.estimate(bins.index == k) for k in range(len(bins.middle))]).reshape(-1, 2)
    return found[:, 0], found[:, 1]


def choose(residuals: Sequence[Residual], along: Sequence[Along], rows: Int[Array, " n"],
           stage: str | None = None) -> tuple[Residual, Along] | None:
    """The number and what to draw it against in which what was put in explains most.

    Numbers of the stage where it happens count for more. Groups are drawn against only where nothing else is asked for.
    """
    best: tuple[float, Residual, Along] | None = None
    for one in [each for each in along if isinstance(each, Covariate)] or along:
        bins = bins_of(one, rows)
        for residual in residuals:
            gained = _roughness(residual.before, bins)
            gained -= 0.0 if residual.after is None else _roughness(residual.after, bins)
            gained *= AT_STAGE if residual.stage == stage and gained > 0.0 else 1.0
            if best is None or gained > best[0]:
                best = gained, residual, one
    return None if best is None else best[1:]


def _roughness(part: Part, bins: Bins) -> float:
    """Log-likelihood that the bins' values explain, times two, less its expectation by chance."""
    value, error = binned(part, bins)
    known = np.isfinite(value) & (error > 0.0)
    return float((((value[known] / error[known])**2) - 1.0).sum())


def stated_covariate(step: Step, along: Sequence[Along], first: str | None) -> str | None:
    """The covariate that the named term follows, or else the one that the finding states."""
    if not step.unknown:
        followed = followed_column(step.column.follows, (one for one in along if isinstance(one, Covariate)))
        if followed is not None:
            return followed
    return first if step.base == () else None


def stage_of(step: Step) -> str | None:
    """Where the step's effect happens: by its name, or by the free change that carries it."""
    if not step.unknown:
        return step.column.stage
    return None if step.place is None else step.place.column.stage


@dataclass(frozen=True)
class View:
    """The residual and the covariate in which an effect shows best; step None: nothing was found. stated: the covariate
    that it follows."""

    step: Step | None
    before: ScoreTable
    after: ScoreTable | None
    stated: Along | None
    residual: Residual
    against: Along


def views_of(fitted: BaselineFit, asked: Asked, steps: Sequence[Step], first: str | None) -> Iterator[View]:
    """One view per step, or one of the fit alone; none where nothing that was recorded varies."""
    along = covariates_in(asked)
    for step in steps or (None,):
        before, after, stated, stage = fitted.evidence, None, None, None
        if step is not None:
            before, after, stage = step.fitted.evidence, evidence_after(step), stage_of(step)
            stated = find_along(stated_covariate(step, along, first), along)
        chosen = choose(residuals_of(before, after, fitted.intake.samples is not None),
                        along if stated is None else (stated,), before.rows, stage)
        if chosen is not None:
            yield View(step, before, after, stated, *chosen)


def halves(along: Along | None, rows: Int[Array, " n"]) -> list[tuple[str, Bool[Array, " n"]]]:
    """All shots (no label), or those low and high in a covariate, or by the levels of a factor of two or three."""
    if isinstance(along, Factor) and len(along.levels) <= MOST_GROUPS:
        return [(f"{along.name} {level}", along.codes[rows] == k) for k, level in enumerate(along.levels)]
    if isinstance(along, Covariate):
        values = along.values[rows]
        middle = float(np.nanmedian(values))
        low, high = values <= middle, values > middle
        if low.any() and high.any():
            return [(f"{along.name} to {middle:.3g}", low), (f"{along.name} above", high)]
    return [("", np.ones(len(rows), dtype=bool))]
