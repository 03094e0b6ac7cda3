"""A simulation fitted to a dataset: coefficients and scatter that all shots share, and the belief made of them."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from truearc.errors import InputError
from truearc.sim.data.dataset import Dataset
from truearc.sim.infer.belief import SCATTER, Belief, Coefficients, scale_of
from truearc.sim.infer.likelihood import observations as outcomes
from truearc.sim.infer.likelihood.data import Intake, take_in
from truearc.sim.infer.likelihood.forward_model import plane_grid
from truearc.sim.infer.likelihood.layout import (
    SCATTER_NAMES,
    LinearizationPoint,
    ParameterLayout,
    believed_name,
    groups_of,
    is_tracker,
    lay_out,
    lean_chain,
    only_shared,
    own_slope,
)
from truearc.sim.infer.likelihood.linearization import Linearization, fly, linearise
from truearc.sim.infer.likelihood.noise import SCATTER_MOST, SCATTER_PRIOR, SCATTERS
from truearc.sim.infer.likelihood.score_table import Array, Column, ScoreTable
from truearc.sim.physics.catalogue import Catalogue, as_catalogue, find_parameter, find_terms
from truearc.sim.physics.nonparametric import CURVE, NAMELESS
from truearc.sim.physics.term import LOG, WatchTerm, complete, fits_scale
from truearc.sim.printed import Progress, part_of

GRID = (-1.0, -0.5, 0.0, 0.5, 1.0)    # of each coefficient's prior, in standard deviations, where the fit may start
SOME = 96                             # outcomes that the grid looks at
MOST_GRID = 3                         # coefficients that are gridded; more start from the prior's centre
SCATTER_GRID = (1.0, 3.0, 10.0)       # times the usual one of a launch
USUAL_SCATTER = np.log([SCATTER_PRIOR[name][0] for name in SCATTERS])
OF_LAUNCH = np.array([name not in ("scatter.distance", *SCATTER_MOST) for name in SCATTERS])
END_REPORTED = {*SCATTERS} - {*SCATTER_MOST}
FEWEST = 5                            # outcomes that the grid can be judged by
ROUNDS = 40                           # of flying, and of steps between two flights
INNER = 10
PATIENCE = 8                          # flights that gain nothing, before what slopes promise is no longer believed
POOR, GOOD = 0.25, 0.75               # of the gain that slopes promise: below it steps get shorter, above it longer
HALVINGS = 8
SETTLED = 1e-3                        # nats
WORTH = 0.02                          # nats: a fifth of a standard error
PART = 0.1                            # of a step that is flown to see whether it gains
TIGHT = 0.1                           # of a tracker's usual errors, where a climb begins
LEAST_ROUNDS = 2                      # with tracks, whose shots' own deviations must settle too
LARGEST_STEP = 2.0                        # usual sizes that a column may move by in one step: all is linear nearby only
SLACK = 0.3                           # nats a step may lose with tracks: scores leave out that slopes change the spread
LEAST_LOG = -9.0                      # of a scatter
MOST_LOG = np.array([np.log(SCATTER_MOST[name]) if name in SCATTER_MOST else 1.0 for name in SCATTERS])
ABSURD, MISFIT = 5.0, 2.0             # times the usual scatter of a launch, or the measured noise of tracks
FEW = 200                             # outcomes up to which the likelihood may have several tops


@dataclass(frozen=True)
class BaselineFit:
    """The believed simulation at its best: where, and the evidence there with the columns asked for."""

    intake: Intake
    layout: ParameterLayout
    spot: LinearizationPoint
    evidence: ScoreTable

    @property
    def values(self) -> dict[str, float]:
        """{shared column: value}; scatters themselves, not their logs."""
        first = self.evidence.first_shared
        named = zip(self.evidence.columns[first:], self.evidence.point[first:], strict=True)
        return {column.name: float(np.exp(value) if column.name.startswith("scatter.") else value)
                for column, value in named if column.kind != "group"}

    @cached_property
    def settled(self) -> bool:
        """Whether no step gains anything that matters: neither by slopes nor, a part of it, once it is flown.

        Of tracks that no flight fits slopes promise more than is there: they leave out how they change themselves.
        """
        layout = only_shared(self.layout)
        here = self.evidence.pick(np.arange(self.evidence.first_shared, len(self.evidence.columns)))
        step, worth = step_within(layout, self.spot, here, np.full(len(layout.columns), True))
        if worth < WORTH:
            return True
        near = moved(layout, self.spot, PART * step)
        near = replace(near, deviates=linearise(self.intake, layout, near)[1]) if self.intake.filmed else near
        there = linearise(self.intake, layout, near)[0]
        return objective(there, layout) - objective(here, layout) < max(WORTH, _slack(self.intake))

    @property
    def together(self) -> Int[Array, " n"]:
        """The cluster of each shot [n] whose shots are correlated when figures are compared: its group, or itself."""
        groups = self.layout.groups
        return np.arange(len(self.evidence.rows)) if groups is None or groups.count == 1 else groups.label

    @property
    def lost(self) -> bool:
        """Whether launches scatter ABSURD times as usual, or tracks MISFIT times as measured: a poor start."""
        return _is_lost(self.spot)


def _is_lost(spot: LinearizationPoint) -> bool:
    wider = np.exp(spot.log_scatter - USUAL_SCATTER)
    return bool((wider[OF_LAUNCH] > ABSURD).any() or wider[SCATTERS.index("scatter.track")] > MISFIT)


def fit_believed(intake: Intake, layout: ParameterLayout, progress: Progress = lambda done, note: None) -> BaselineFit:
    """Most probable shared columns by Newton's method with halved steps, relinearised at every step."""
    bare = only_shared(layout)
    starts = usual_starts(intake, layout)
    many = intake.samples is None and len(intake.marked) > FEW
    starts = starts[:1] if intake.samples is not None else (*starts, usual_spot(intake, layout))
    tops = []
    for k, start in enumerate(starts):
        tops.append(top_from(intake, bare, start, part_of(progress, 0.9 * k / len(starts), 0.9 / len(starts))))
        if many and not _is_lost(tops[-1][0]):     # many outcomes have one top, except those that call all scatter
            break
    spot = max(tops, key=lambda top: (not (many and _is_lost(top[0])), objective(top[1], bare)))[0]
    progress(0.9, "slopes")
    return BaselineFit(intake, layout, spot, linearise(intake, layout, spot)[0])


def top_from(intake: Intake, layout: ParameterLayout, spot: LinearizationPoint,
             progress: Progress = lambda done, note: None) -> tuple[LinearizationPoint, ScoreTable]:
    """The top that a climb from the spot comes to, after one over easier ground.

    A height that is a slip costs a few nats however far it is off, so that a climb from far away may end where half of
    the heights are called slips; where nothing scores yet, physics by which heights scatter more looks better than
    physics that aims; and a tracker's errors, which may be large, bend flights as any physics does. First no height may
    be a slip, physics does not change how heights scatter, and the tracker has hardly any error.
    """
    if intake.samples is None or intake.seen.measured.any():
        strict = replace(intake, seen=replace(intake.seen, slips=False))
        spot = climb(strict, replace(layout, steady=True), spot, part_of(progress, 0.0, 0.5))[0]
    tight = np.array([TIGHT if is_tracker(column, layout.chain.catalogue) else 1.0
                      for column in layout.columns[layout.first_shared:]])
    if (tight != 1.0).any():
        exact = replace(layout, precision=layout.precision / np.outer(tight, tight))
        spot = climb(intake, exact, spot, part_of(progress, 0.0, 0.5))[0]
    return climb(intake, layout, spot, part_of(progress, 0.5, 0.5))


def climb(intake: Intake, layout: ParameterLayout, spot: LinearizationPoint,
          progress: Progress = lambda done, note: None,
          held: Bool[Array, " P"] | None = None) -> tuple[LinearizationPoint, ScoreTable]:
    """Uphill in all columns of the layout, which must all be shared ones, until a step is far below their deviations.

    Between flights all is taken as linear; it is flown again at each top so found, until the top stays. Columns that
    are `held` stay where they are.
    """
    free = np.full(len(layout.columns), True) if held is None else ~held
    highest, idle, reach, gain = -np.inf, 0, np.inf, 0.0
    kept: _Visited | None = None
    for number in range(ROUNDS):
        progress(number / ROUNDS, "fit")
        flown = fly(intake, layout, spot)
        evidence, _ = linearise(intake, layout, spot, flown)
        here = _Visited(spot, flown, evidence, objective(evidence, layout))
        idle = 0 if here.value > highest + _slack(intake) else idle + 1
        highest = max(highest, here.value)
        if idle > PATIENCE:
            break
        gained = -np.inf if kept is None else here.value - kept.value
        if kept is not None and gained < POOR * gain:         # flights bend more than was allowed for
            reach = 0.5 * _distance(layout, kept.evidence, evidence)
        elif gained > GOOD * gain:
            reach *= 2.0
        if kept is None or gained >= -_slack(intake):
            kept = here
            enough = number >= LEAST_ROUNDS * (intake.samples is not None)
            if enough and step_within(layout, spot, evidence, free)[1] < SETTLED:
                break
        top, found, gain = _climb_linear(intake, layout, kept, free, reach)
        spot = replace(top, deviates=found)
    assert kept is not None
    return kept.spot, kept.evidence


class _Visited(NamedTuple):
    """A spot with what was flown there, and the log posterior."""

    spot: LinearizationPoint
    flown: Linearization
    evidence: ScoreTable
    value: float


def _distance(layout: ParameterLayout, a: ScoreTable, b: ScoreTable) -> float:
    """The largest difference of a column, in usual sizes."""
    usual = np.array([column.usual for column in layout.columns])
    return float(np.abs((a.point - b.point) / usual).max(initial=0.0))


def _climb_linear(intake: Intake, layout: ParameterLayout, start: _Visited, free: Bool[Array, " P"],
                  reach: float) -> tuple[LinearizationPoint, Float[Array, "n D"], float]:
    """(the top without flying again, most likely deviates there, nats gained), no column farther from the start than
    `reach` usual sizes."""
    usual = np.array([column.usual for column in layout.columns])
    spot, best = start.spot, start.value
    evidence, deviates = linearise(intake, layout, spot, start.flown)
    for _ in range(INNER):
        step, worth = step_within(layout, spot, evidence, free)
        if worth < SETTLED or not np.isfinite(step).all():
            break
        room = (reach * usual - np.sign(step) * (evidence.point - start.evidence.point)) / np.maximum(abs(step), 1e-300)
        step = step * min(1.0, LARGEST_STEP / max(float(np.abs(step / usual).max(initial=0.0)), 1e-300),
                          max(float(room.min(initial=np.inf)), 0.0))
        for halving in range(HALVINGS):
            tried = moved(layout, spot, step * 0.5**halving)
            there, found = linearise(intake, layout, tried, start.flown)
            value = objective(there, layout)
            if value >= best - _slack(intake):
                break
        else:
            break
        closer = abs(value - best) < SETTLED and reach < np.inf
        best, spot, evidence, deviates = value, tried, there, found
        if closer:
            break
    return spot, deviates, best - start.value


def newton_step(evidence: ScoreTable,
                free: Bool[Array, " P"] | slice = slice(None)) -> tuple[Float[Array, " P"], float]:
    """(Fisher scoring step for layouts of shared columns only, nats that it promises); columns that are not `free`
    stay."""
    info, slope = evidence.information + evidence.precision, evidence.score.sum(0) + evidence.pull
    info, slope, step = info[free][:, free], slope[free], np.zeros(len(slope))
    step[free] = np.linalg.solve(info + 1e-12 * np.diag(np.diag(info) + 1e-12), slope)
    return step, 0.5 * float(step[free] @ slope)


def step_within(layout: ParameterLayout, spot: LinearizationPoint, evidence: ScoreTable,
                free: Bool[Array, " P"]) -> tuple[Float[Array, " P"], float]:
    """The same; what is at a limit and would go beyond it stays, so that the others go where it is best for it there.
    """
    free = free.copy()
    while True:
        step, worth = newton_step(evidence, free)
        out = free & _leads_out(layout, spot, step)
        if not out.any():
            return step, worth
        free &= ~out


def _leads_out(layout: ParameterLayout, spot: LinearizationPoint, step: Float[Array, " P"]) -> Bool[Array, " P"]:
    """Which columns are at a limit of theirs that the step is to lead beyond."""
    out = np.full(len(layout.columns), False)
    slots = np.flatnonzero(layout.in_slot)
    source = layout.source[slots]
    (low, high), values = _bounds(layout.chain.slots, layout.chain.catalogue), spot.values[source]
    out[slots] = ((values <= low[source]) & (step[slots] < 0.0)) | ((values >= high[source]) & (step[slots] > 0.0))
    for number, column in enumerate(layout.scatters):
        out[column] |= column >= 0 and step[column] > 0.0 and spot.log_scatter[number] >= MOST_LOG[number]
    return out


def objective(evidence: ScoreTable, layout: ParameterLayout) -> float:
    """Log posterior, up to a constant."""
    off = evidence.point[evidence.first_shared:] - layout.centre
    value = float(evidence.log_score.sum() - 0.5 * off @ layout.precision @ off)
    return value if np.isfinite(value) else -np.inf


def moved(layout: ParameterLayout, spot: LinearizationPoint, change: Float[Array, " P"]) -> LinearizationPoint:
    """The spot after its columns change by `change`, parameters no further than they can go; log scatters by no
    more than 1 at a time."""
    values, log_scatter = spot.values.copy(), spot.log_scatter.copy()
    values[layout.source[layout.in_slot]] += change[layout.in_slot]
    values = np.clip(values, *_bounds(layout.chain.slots, layout.chain.catalogue))
    for number, column in enumerate(layout.scatters):
        if column >= 0:
            log_scatter[number] = np.clip(log_scatter[number] + np.clip(change[column], -1.0, 1.0), LEAST_LOG,
                                          MOST_LOG[number])
    return LinearizationPoint(values, log_scatter, spot.deviates, spot.effects + change[layout.source == -2])


def out_of_range(values: Mapping[str, float], among: Catalogue) -> list[str]:
    """Names ("term.parameter") of values that no fit may come to, or that stopped at their limit; scatters have none.
    """
    slots = tuple(tuple(name.split(".", 1)) for name in values if not name.startswith("scatter."))
    low, high = _bounds(slots, among)
    return [".".join(slot) for slot, least, most in zip(slots, low, high, strict=True)
            if not least < values[".".join(slot)] < most]


def stopped(evidence: ScoreTable, among: Catalogue) -> dict[str, float]:
    """Fitted numbers of terms, a tracker's among them, and scatters that stopped at the end of their range, by name."""
    points = [(one, float(at)) for one, at in zip(evidence.columns, evidence.point, strict=True) if one.kind != "group"]
    values = {one.name: at for one, at in points if among.get(one.term) is not None}
    found = {name: values[name] for name in out_of_range(values, among)}
    return found | {one.name: float(np.exp(at)) for one, at in points if one.name in END_REPORTED and at >= 1.0}


def limits_of(layout: ParameterLayout, column: int) -> tuple[float, float]:
    """Lowest and highest that a column may come to; a logarithm of a scatter by no more than its fit may."""
    if not layout.in_slot[column]:
        return LEAST_LOG, float(MOST_LOG[SCATTERS.index(layout.columns[column].name)])
    low, high = _bounds(layout.chain.slots, layout.chain.catalogue)
    return float(low[layout.source[column]]), float(high[layout.source[column]])


@cache
def _bounds(slots: tuple[tuple[str, str], ...],
            among: Catalogue) -> tuple[Float[Array, " slots"], Float[Array, " slots"]]:
    """Lowest and highest that a fit may come to. A parameter's declared range, in which it is looked for, goes
    on below zero where its scale does: lift may be reversed, an efficiency above one; drag cannot drive."""
    parameters = [find_parameter(".".join(slot), among) for slot in slots]
    low = [one.low if one.prior is not None and one.prior.scale == LOG else min(one.low, -one.high)
           for one in parameters]
    return np.array(low), np.array([one.high for one in parameters])






def _slack(intake: Intake) -> float:
    return SETTLED if intake.samples is None else SLACK


def usual_starts(intake: Intake, layout: ParameterLayout) -> tuple[LinearizationPoint, ...]:
    """Where to climb from, the likeliest first: for each size of the scatter the best of a grid over up to MOST_GRID
    coefficients, by outcomes; without outcomes the prior's middle alone."""
    usual = usual_spot(intake, layout)
    if len(intake.marked) < FEWEST:
        return (usual,)
    first, slots = layout.first_shared, layout.chain.slots
    shared = [k for k in range(first, len(layout.columns))
              if layout.in_slot[k] and slots[layout.source[k]][0] != CURVE]
    known = np.sqrt(np.diag(np.linalg.inv(layout.precision)))
    axes = [(layout.source[k], layout.centre[k - first], known[k - first]) for k in shared][:MOST_GRID]
    steps = np.array(list(itertools.product(GRID, repeat=len(axes))))
    points = np.tile(usual.values, (len(steps), 1))
    for number, (slot, centre, sd) in enumerate(axes):
        points[:, slot] = centre + steps[:, number] * sd
    likelihood = rough_likelihood(intake, layout, points) - 0.5 * (steps**2).sum(1)[:, None]
    return tuple(replace(usual, values=points[likelihood[:, k].argmax()],
                         log_scatter=usual.log_scatter + np.log(SCATTER_GRID[k]) * OF_LAUNCH)
                 for k in np.argsort(-likelihood.max(0)))


def usual_spot(intake: Intake, layout: ParameterLayout) -> LinearizationPoint:
    """Coefficients and scatters in the middle of their priors, no shot off its configuration."""
    values = layout.usual.copy()
    own = layout.in_slot[layout.first_shared:]
    values[layout.source[layout.first_shared:][own]] = layout.centre[own]
    return LinearizationPoint.still(layout, len(intake.rows), values, USUAL_SCATTER)


def believed_spot(intake: Intake, layout: ParameterLayout) -> LinearizationPoint:
    """The usual spot, with the scatters as the belief has them."""
    spot = usual_spot(intake, layout)
    log_scatter = np.array([usual if column < 0 else layout.centre[column - layout.first_shared]
                            for usual, column in zip(spot.log_scatter, layout.scatters, strict=True)])
    return replace(spot, log_scatter=log_scatter)


def rough_likelihood(intake: Intake, layout: ParameterLayout, points: Float[Array, "points slots"],
                     kept: Sequence[int] = ()) -> Float[Array, "points scatters"]:
    """Log-likelihood of some of the outcomes, at some sizes of one scatter of the height; with the terms of the `kept`
    columns in the air."""
    some = np.arange(len(intake.marked))[::-(-len(intake.marked) // SOME)]
    lanes = intake.lanes.take(np.resize(intake.marked[some], SOME))
    mean, near = (np.asarray(part)[:, :len(some)]
                  for part in plane_grid(lean_chain(layout, list(kept)), lanes, jnp.asarray(points)))
    mean = np.where(near, mean, -10.0)
    seen = intake.seen.take(some)
    return np.array([[outcomes.log_likelihood(seen, row, np.full(len(row), 0.08 * factor)).sum()
                      for factor in SCATTER_GRID] for row in mean])


SCATTERED = {"scatter.speed": ("of the exit speed", "exit speed from shot to shot (sd)"),
             "scatter.elevation_deg": ("deg", "exit angle from shot to shot (sd)")}

IMPROBABLE = 2.58                     # prior standard deviations that a hundredth of the prior lies beyond


@dataclass(frozen=True)
class Sought:
    """One fitted number.

    column: its place in the fit. Its prior has `centre` and `sd` in the parameter's own unit; of a scatter they are the
    logarithm's, in the column's unit. percent: shown in per cent.
    """

    name: str
    unit: str
    meaning: str
    percent: bool
    column: int
    centre: float
    sd: float

    @property
    def scatters(self) -> bool:
        return self.name.startswith(SCATTER + ".")

    def value(self, at: float) -> float:
        """The number itself where its column is `at`."""
        if not self.scatters:
            return at
        return float(np.degrees(np.exp(at)) if self.name.endswith("_deg") else np.exp(at))

    def at(self, value: float) -> float:
        """The inverse of `value`."""
        if not self.scatters:
            return value
        return float(np.log(np.radians(value) if self.name.endswith("_deg") else value))

    def improbable(self, value: float) -> bool:
        """Whether it was believed all but impossible."""
        return abs(self.at(value) - self.centre) > IMPROBABLE * self.sd

    def slope(self, at: float) -> float:
        """d value / d column."""
        return self.value(at) if self.scatters else 1.0


def improbable(layout: ParameterLayout, point: Float[np.ndarray, " p"]) -> dict[str, float]:
    """Return the fitted numbers of terms that were believed all but impossible: {name: value at `point`}."""
    found = {one.name: (one, one.value(float(point[one.column]))) for one in sought_of(layout) if not one.scatters}
    return {name: value for name, (one, value) in found.items() if one.improbable(value)}


def sought_of(layout: ParameterLayout) -> tuple[Sought, ...]:
    """The numbers of terms, a tracker's among them, and of the launch's scatter; not random effects, nor scatters that
    no belief keeps."""
    sd: Float[np.ndarray, " p"] = np.sqrt(np.diag(np.linalg.inv(layout.precision)))
    found = []
    first = layout.first_shared
    for k, column in enumerate(layout.columns[first:], first):
        name, centre, wide = believed_name(column.name), float(layout.centre[k - first]), float(sd[k - first])
        if name in SCATTERED:
            unit, meaning = SCATTERED[name]
            found.append(Sought(name, unit, meaning, name == "scatter.speed", k, centre, wide))
        elif layout.in_slot[k]:
            one = find_parameter(name, layout.chain.catalogue)
            found.append(Sought(name, one.unit, one.meaning, one.percent, k, centre, wide))
    return tuple(found)


def belongs(column: Column, among: Catalogue) -> bool:
    """A parameter of the simulation or a scatter of the launch, not a ball's random effect or a tracker's calibration.
    """
    if column.kind == "group" or is_tracker(column, among):
        return False
    return column.name in SCATTER_NAMES or not column.name.startswith(SCATTER + ".")


def believed_columns(evidence: ScoreTable, among: Catalogue) -> list[int]:
    """Places of the shared columns that belong to a belief."""
    return [k for k in range(evidence.first_shared, len(evidence.columns)) if belongs(evidence.columns[k], among)]


def coefficients_of(evidence: ScoreTable, believed: tuple[str, ...], among: Catalogue) -> Coefficients:
    """Every believed and named term of the catalogue, with parameters that were not fitted at their defaults."""
    tracker = (term.name for term in among if isinstance(term, WatchTerm))
    apart = {*among.always, *tracker, *(term.name for term in NAMELESS)}
    given: Coefficients = {name: {} for name in believed if name not in apart}
    for k in believed_columns(evidence, among):
        term, _, parameter = evidence.columns[k].name.partition(".")
        if term not in (SCATTER, CURVE):
            given.setdefault(term, {})[parameter] = float(evidence.point[k])
    return {name: {key: float(value) for key, value in complete(find_terms([name], among)[0], values).items()}
            for name, values in given.items()}


def scatter_of(evidence: ScoreTable) -> dict[str, float]:
    """Scatters of the launch by their names in a belief."""
    found = {column.name: float(np.exp(value)) for column, value in zip(evidence.columns, evidence.point, strict=True)
             if column.name in SCATTER_NAMES}
    return {SCATTER_NAMES[name]: float(np.degrees(value)) if name.endswith("_rad") else value
            for name, value in found.items()}


def covariance_of(evidence: ScoreTable, among: Catalogue) -> tuple[tuple[str, ...], Float[np.ndarray, "p p"]]:
    """(names, covariance on their scales); a number that does not fit on its scale counts as exact."""
    whole = evidence.covariance
    columns = believed_columns(evidence, among)
    names = {k: believed_name(evidence.columns[k].name) for k in columns}
    kept = [k for k in columns if evidence.columns[k].name in SCATTER_NAMES
            or fits_scale(scale_of(names[k], among), float(evidence.point[k]))]
    slope = np.array([1.0 / own_slope(evidence.columns[k].name, float(evidence.point[k]), among) for k in kept])
    return tuple(names[k] for k in kept), whole[np.ix_(kept, kept)] * np.outer(slope, slope)


@dataclass(frozen=True, eq=False)
class MapFit:
    """The fit of `terms` (gravity always among them) to a dataset, whose shots are in order."""

    dataset: Dataset
    terms: tuple[str, ...]
    fitted: BaselineFit

    @property
    def evidence(self) -> ScoreTable:
        return self.fitted.evidence

    @property
    def catalogue(self) -> Catalogue:
        return self.fitted.layout.chain.catalogue

    @property
    def converged(self) -> bool:
        return self.fitted.settled

    @property
    def log_posterior(self) -> float:
        """At the fit, up to a constant."""
        return objective(self.evidence, self.fitted.layout)

    @property
    def at_limit(self) -> dict[str, float]:
        """Fitted numbers that stopped at the end of their range, by name."""
        return stopped(self.evidence, self.catalogue)

    @cached_property
    def sought(self) -> tuple[Sought, ...]:
        """The fitted numbers that are reported, a tracker's errors among them."""
        return sought_of(self.fitted.layout)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of these."""
        return tuple(one.name for one in self.sought)

    @property
    def values(self) -> dict[str, float]:
        """{name: most probable value} of these."""
        return {one.name: one.value(float(self.evidence.point[one.column])) for one in self.sought}

    @cached_property
    def covariance(self) -> Float[np.ndarray, "p p"]:
        """Of these, in units of their priors' standard deviations: the inverse of prior and expected information."""
        whole = self.evidence.covariance
        columns = [one.column for one in self.sought]
        sd = np.array([one.sd for one in self.sought])
        return np.asarray(whole[np.ix_(columns, columns)] / np.outer(sd, sd))

    @cached_property
    def belief(self) -> Belief:
        """For whoever forecasts or simulates: without the tracker's errors and random effects."""
        coefficients = coefficients_of(self.evidence, self.terms, self.catalogue)
        names, covariance = covariance_of(self.evidence, self.catalogue)
        return Belief(coefficients, scatter_of(self.evidence), names, covariance, catalogue=self.catalogue)


def fit_map(dataset: Dataset, terms: tuple[str, ...], progress: Progress = lambda done, note: None,
            among: Catalogue | None = None) -> MapFit:
    """Fit the named terms (gravity always among them) and the scatter of the launch to a dataset.

    among: the catalogue of the terms, truearc.sim.physics.catalogue.catalogue() when not given.

    Deterministic. A fit that did not settle says so in `converged`. InputError: unknown terms, or nothing to fit to.
    """
    catalogue = as_catalogue(among)
    catalogue.find(terms)
    names = (*catalogue.always, *(name for name in terms if name not in catalogue.always))
    dataset = dataset.in_order()
    intake = take_in(dataset, fewest=1)
    if not len(intake.rows):
        why = "; ".join(intake.left_out) or "there are no shots"
        raise InputError(f"{dataset.shots.source}: there is nothing to fit to, neither a track nor a shot with both a "
                         f"launch and something seen of its flight: {why}")
    layout = only_shared(lay_out(intake, names, groups_of(dataset.shots, intake.rows), catalogue))
    return MapFit(dataset, names, fit_believed(intake, layout, progress))
