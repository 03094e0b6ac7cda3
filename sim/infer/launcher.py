"""The launcher as the model of a fit: its shots and columns, where the optimization starts and ends, and its belief."""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from scipy.special import ndtr, ndtri

from truearc.errors import InputError
from truearc.sim.data.dataset import Dataset
from truearc.sim.infer.belief import SCATTER, Belief, Coefficients, Curve, scale_of
from truearc.sim.infer.fit import Fit, fit_believed
from truearc.sim.infer.likelihood import layout as lay
from truearc.sim.infer.likelihood import linearization
from truearc.sim.infer.likelihood.data import FEWEST_SHOTS, Intake, take_in
from truearc.sim.infer.likelihood.forward_model import plane_grid
from truearc.sim.infer.likelihood.layout import SCATTER_NAMES, Layout, Point, believed_name, is_tracker, own_slope
from truearc.sim.infer.likelihood.noise import SCATTER_MOST, SCATTER_PRIOR, SCATTERS, WEAKER
from truearc.sim.infer.likelihood.score_table import Array, Column, ScoreTable
from truearc.sim.infer.model import Carrying, Shapes
from truearc.sim.physics.catalogue import (
    CURVE,
    NAMELESS,
    Catalogue,
    as_catalogue,
    find_nameless,
    find_parameter,
    find_terms,
)
from truearc.sim.physics.term import (
    LOG,
    Parameter,
    WatchTerm,
    complete,
    fits_scale,
    from_scale,
    to_scale,
)
from truearc.sim.printed import Progress

GRID = (-1.0, -0.5, 0.0, 0.5, 1.0)    # of each coefficient's prior, in standard deviations, where the fit may start
SOME = 96                             # outcomes that the grid looks at
MOST_GRID = 3                         # coefficients that are gridded; more start from the prior's centre
SCATTER_GRID = (1.0, 3.0, 10.0)       # times the usual one of a launch
USUAL_SCATTER = np.log([SCATTER_PRIOR[name][0] for name in SCATTERS])
OF_LAUNCH = np.array([name not in ("scatter.distance", *SCATTER_MOST) for name in SCATTERS])
END_REPORTED = {*SCATTERS} - {*SCATTER_MOST}
# Chosen: more than MOST_GRID coefficients and a scatter
FEWEST = 5                            # outcomes that the grid can be judged by
TIGHT = 0.1                           # of a tracker's usual errors, where a climb begins
LEAST_LOG = -9.0                      # of a scatter
MOST_LOG = np.array([np.log(SCATTER_MOST[name]) if name in SCATTER_MOST else 1.0 for name in SCATTERS])
# Derived: the first is beyond 93 % of the scatter's prior, a factor of 3; chosen: the second, twice, since noise is
# measured to a tenth or better
ABSURD, MISFIT = 5.0, 2.0             # times the usual scatter of a launch, or the measured noise of tracks
# Measured: with more, practice of the demo went from 56 to 87 and from 41 to 92 threes of 120 by another start (git
# show 65661fcd)
FEW = 200                             # outcomes up to which the likelihood may have several tops
# Derived: normal quantile 0.995
IMPROBABLE = 2.58                     # prior standard deviations that a hundredth of the prior lies beyond
# Chosen: as FALSE_ALARM; each of k numbers then has ODD / k. Measured: of 60 sound simulated datasets none has one
ODD = 0.05                            # share of rigs, as the priors have them, with a number at an odd place
# Derived: normal quantile 0.9995; the fit's prior is WEAKER times as wide as the catalogue's
CREDIBLE_SD = 3.29                    # standard deviations of a prior within which a parameter is believable
CURVE_POINTS = 8                      # of an unexplained change; with the shortest length no bend is lost
STRONG = 10.0                         # factor by which strong evidence raises odds (Jeffreys 1961, appendix B)


@dataclass(frozen=True)
class ShapeParameter:
    """A number of a term besides its amplitude that is not a column: its slot in the chain, and its declaration."""

    slot: int
    parameter: Parameter

    def put(self, point: Point, place: float) -> Point:
        """Return the point with the number `place` standard deviations from its prior's centre, within its range."""
        prior = self.parameter.prior
        assert prior is not None
        value = float(from_scale(prior.scale, to_scale(prior.scale, prior.centre) + place * prior.sd))
        values = point.values.copy()
        values[self.slot] = np.clip(value, self.parameter.low, self.parameter.high)
        return replace(point, values=values)


@dataclass(frozen=True)
class Launcher:
    """Shots of a launcher, and the columns that are fitted to and tested on them (truearc.sim.infer.fit.Model)."""

    data: Intake
    layout: Layout

    @staticmethod
    def of(dataset: Dataset, believed: tuple[str, ...], among: Catalogue | None = None, belief: Belief | None = None,
           later: Layout | None = None, fewest: int = FEWEST_SHOTS) -> "Launcher":
        """Make a launcher from a dataset whose balls or sessions may differ at random; arguments and errors as of
        `take_in` and `lay_out`."""
        data = take_in(dataset, {} if belief is None else belief.curves, fewest)
        groups = lay.groups_of(dataset.shots, data.rows)
        return Launcher(data, lay.lay_out(data, believed, groups, among, belief, later))

    @property
    def catalogue(self) -> Catalogue:
        return self.layout.chain.catalogue

    @property
    def sampled(self) -> bool:
        return self.data.samples is not None

    @property
    def has_one_top(self) -> bool:
        """Whether there is a single optimum: true for many outcomes, apart from those that attribute everything to
        scatter."""
        return not self.sampled and len(self.data.marked) > FEW

    def fly(self, point: Point) -> linearization.Linearization:
        return linearization.fly(self.data, self.layout, point)

    def linearise(self, point: Point, flown: linearization.Linearization | None = None) -> tuple[ScoreTable, Point]:
        scores, deviates = linearization.linearise(self.data, self.layout, point, flown)
        return scores, replace(point, deviates=deviates)

    def forecast(self, point: Point) -> ScoreTable:
        """Return scores without the shot's own track or measured exit."""
        blind = replace(self.data, samples=None, scatter=None, exits=np.full(self.data.exits.shape, np.nan))
        return linearization.linearise(blind, self.layout, replace(point, deviates=np.zeros_like(point.deviates)))[0]

    def about(self, point: Point) -> Point:
        return self.linearise(point)[1] if self.data.filmed else point

    def moved(self, point: Point, change: Float[Array, " P"]) -> Point:
        """Return the moved point; parameters stay in their range, and log scatters change by at most 1 at a time."""
        layout, values, log_scatter = self.layout, point.values.copy(), point.log_scatter.copy()
        values[layout.source[layout.in_slot]] += change[layout.in_slot]
        values = np.clip(values, *_bounds(layout.chain.slots, self.catalogue))
        for number, column in enumerate(layout.scatters):
            if column >= 0:
                log_scatter[number] = np.clip(log_scatter[number] + np.clip(change[column], -1.0, 1.0), LEAST_LOG,
                                              MOST_LOG[number])
        return Point(values, log_scatter, point.deviates, point.effects + change[layout.source == -2])

    def leads_out(self, point: Point, step: Float[Array, " P"]) -> Bool[Array, " P"]:
        layout, out = self.layout, np.full(len(self.layout.columns), False)
        slots = np.flatnonzero(layout.in_slot)
        source = layout.source[slots]
        (low, high), values = _bounds(layout.chain.slots, self.catalogue), point.values[source]
        out[slots] = ((values <= low[source]) & (step[slots] < 0.0)) | ((values >= high[source]) & (step[slots] > 0.0))
        for number, column in enumerate(layout.scatters):
            out[column] |= column >= 0 and step[column] > 0.0 and point.log_scatter[number] >= MOST_LOG[number]
        return out

    def limits(self, column: int) -> tuple[float, float]:
        """Return the lowest and highest value of a column; for the log of a scatter, at most what its fit allows."""
        layout = self.layout
        if not layout.in_slot[column]:
            return LEAST_LOG, float(MOST_LOG[SCATTERS.index(layout.columns[column].name)])
        low, high = _bounds(layout.chain.slots, self.catalogue)
        return float(low[layout.source[column]]), float(high[layout.source[column]])

    def is_lost(self, point: Point) -> bool:
        """Return whether launches scatter ABSURD times as usual, or tracks MISFIT times as measured."""
        wider = np.exp(point.log_scatter - USUAL_SCATTER)
        return bool((wider[OF_LAUNCH] > ABSURD).any() or wider[SCATTERS.index("scatter.track")] > MISFIT)

    def middle(self) -> Point:
        """Return coefficients and scatters at their priors' centres, without deviations of single shots."""
        layout = self.layout
        values, own = layout.usual.copy(), layout.in_slot[layout.first_shared:]
        values[layout.source[layout.first_shared:][own]] = layout.centre[own]
        return Point.still(layout, len(self.data.rows), values, USUAL_SCATTER)

    def believed(self) -> Point:
        """Return the middle with the belief's scatters."""
        layout, middle = self.layout, self.middle()
        log_scatter = np.array([usual if column < 0 else layout.centre[column - layout.first_shared]
                                for usual, column in zip(middle.log_scatter, layout.scatters, strict=True)])
        return replace(middle, log_scatter=log_scatter)

    def starts(self) -> tuple[Point, ...]:
        """Return, for each size of the scatter, the best of a grid over up to MOST_GRID coefficients, by outcomes, then
        the priors' middle; for tracks only the first; at an opening that faces up only the middle (b297f03e)."""
        middle, layout = self.middle(), self.layout
        if len(self.data.marked) < FEWEST or self.data.seen.axes > 1:
            return (middle,)
        first, slots = layout.first_shared, layout.chain.slots
        shared = [k for k in range(first, len(layout.columns))
                  if layout.in_slot[k] and slots[layout.source[k]][0] != CURVE]
        known = np.sqrt(np.diag(np.linalg.inv(layout.precision)))
        axes = [(layout.source[k], layout.centre[k - first], known[k - first]) for k in shared][:MOST_GRID]
        steps = np.array(list(itertools.product(GRID, repeat=len(axes))))
        points = np.tile(middle.values, (len(steps), 1))
        for number, (slot, centre, sd) in enumerate(axes):
            points[:, slot] = centre + steps[:, number] * sd
        likelihood = self.rough_likelihood(points) - 0.5 * (steps**2).sum(1)[:, None]
        found = tuple(replace(middle, values=points[likelihood[:, k].argmax()],
                              log_scatter=middle.log_scatter + np.log(SCATTER_GRID[k]) * OF_LAUNCH)
                      for k in np.argsort(-likelihood.max(0)))
        return found[:1] if self.sampled else (*found, middle)

    def rough_likelihood(self, points: Float[Array, "points slots"],
                         kept: Sequence[int] = ()) -> Float[Array, "points scatters"]:
        """Return the log-likelihood of some of the outcomes, at some sizes of one scatter of the height, with the terms
        of the `kept` columns in the air."""
        marked = self.data.marked
        some = np.arange(len(marked))[::-(-len(marked) // SOME)]
        lanes = self.data.lanes.take(np.resize(marked[some], SOME))
        mean, near = (np.asarray(part)[:, :len(some)]
                      for part in plane_grid(lay.lean_chain(self.layout, list(kept)), lanes, jnp.asarray(points)))
        mean = np.where(near, mean, linearization.FAR_BELOW_M)
        seen = self.data.seen.take(some)
        # 8 cm: a usual scatter of the height at 4 m (SCATTER_PRIOR)
        return np.array([[seen.log_likelihood(row, np.full(len(row), 0.08 * factor)).sum()
                          for factor in SCATTER_GRID] for row in mean])

    def easier(self) -> Iterable["Launcher"]:
        """Return easier models: first no height may be a slip, and physics does not change the scatter of heights; then
        the tracker has hardly any error.

        A height that is a slip costs a few nats however far it is off, so that a climb from far away may end where half
        of the heights are called slips; where nothing scores yet, physics by which heights scatter more looks better
        than physics that aims; and a tracker's errors, which may be large, bend flights as any physics does.
        """
        data, layout = self.data, self.layout
        if not self.sampled or data.seen.measured.any():
            yield Launcher(replace(data, seen=data.seen.without_slips()), replace(layout, steady=True))
        tight = np.array([TIGHT if is_tracker(column, self.catalogue) else 1.0
                          for column in layout.columns[layout.first_shared:]])
        if (tight != 1.0).any():
            yield Launcher(data, replace(layout, precision=layout.precision / np.outer(tight, tight)))

    def afar(self, change: Float[Array, " P"]) -> tuple[Point, Iterable["Launcher"]]:
        return (self.middle(), self.easier()) if self.data.filmed else (self.moved(self.middle(), change), ())

    def shapes(self, names: tuple[str, ...]) -> list[ShapeParameter]:
        """Return those of the named terms that have a prior and are not yet fitted as columns."""
        columns, slots = {column.name for column in self.layout.columns}, self.layout.chain.slots
        terms = find_terms({name.partition(".")[0] for name in names}, self.catalogue)
        return [ShapeParameter(slots.index((term.name, one.name)), one) for term in terms
                for one in term.parameters[1:] if one.prior is not None and f"{term.name}.{one.name}" not in columns]

    def shapes_at(self, point: Point, names: tuple[str, ...]) -> Coefficients:
        """Return {term: {parameter: value}} of them at a point."""
        return {self.layout.chain.slots[one.slot][0]: {one.parameter.name: float(point.values[one.slot])}
                for one in self.shapes(names)}

    def shared_only(self, names: Iterable[str] = ()) -> "Launcher":
        return Launcher(self.data, lay.only_shared(self.layout, names))

    def sharing(self, names: tuple[str, ...]) -> "Launcher":
        return Launcher(self.data, lay.promoted(self.layout, names))

    def along(self, term: str, values: Mapping[str, float], curve: Curve,
              by: Float[Array, "n points"]) -> "Launcher":
        """Return the launcher with a nameless term that goes along a curve, whose shapes at the shots are `by`."""
        lanes = self.data.lanes
        before = np.asarray(lanes.circumstances.curve_by)
        around = lanes.circumstances._replace(curve_by=np.concatenate([before, by], axis=1) if before.ndim == 2 else by)
        return Launcher(replace(self.data, lanes=lanes._replace(circumstances=around)),
                        lay.with_curve(self.layout, term, values, curve))

    def extended(self, point: Point) -> Point:
        """Return a point of the launcher before `along`, with the curves as they were given."""
        return replace(point, values=np.concatenate([point.values, self.layout.usual[len(point.values):]]))

    def range_of(self, name: str) -> tuple[float, float]:
        one = find_parameter(name, self.catalogue)
        return one.low, one.high

    def law_of(self, name: str) -> tuple[float | None, float]:
        term = find_terms((name.partition(".")[0],), self.catalogue)[0]
        return term.law_sd, term.positive

    def is_natural(self, name: str, amplitude: float) -> bool:
        prior = find_parameter(name, self.catalogue).prior
        if prior is None or prior.scale != LOG:
            return True
        return bool(amplitude <= from_scale(prior.scale, to_scale(prior.scale, prior.centre) + CREDIBLE_SD * prior.sd))

    def label_of(self, name: str) -> str:
        return self.catalogue.find((name.partition(".")[0],))[0].label

    def describe(self, name: str) -> tuple[str, str] | None:
        if self.catalogue.get(name.partition(".")[0]) is None:
            return None
        one = find_parameter(name, self.catalogue)
        return one.meaning, one.unit

    def stopped(self, scores: ScoreTable) -> dict[str, float]:
        return stopped(scores, self.catalogue)

    def strange(self, scores: ScoreTable, beside: Iterable[str], trackers: bool) -> dict[str, float]:
        """Return parameters of believed terms more than CREDIBLE_SD standard deviations of the prior from its centre.

        Parameters of an earlier session may change and do not count; those of a tracker only if `trackers`.
        """
        layout, first, named = self.layout, self.layout.first_shared, {*beside}
        sd = np.sqrt(np.diag(np.linalg.inv(layout.precision)))
        far = layout.in_slot[first:] & (np.abs(scores.point[first:] - layout.centre) > CREDIBLE_SD * sd)
        return {column.name: float(value) for column, value, out in zip(
            layout.columns[first:], scores.point[first:], far, strict=True)
            if out and not column.told and column.name not in named
            and (trackers or not is_tracker(column, self.catalogue))}

    def exchanged(self, name: str, best: "Launcher", point: Point, start: Point) -> Point:
        values, own = point.values.copy(), best.layout.source[0]
        values[own] = start.values[own]
        return replace(point, values=values)

    def carrying(self, point: Point, lost: bool, part: Shapes) -> "Carrying[Launcher] | None":
        """Return the launcher with a nameless term along a curve of zero: a step on slopes may lead to where the flown
        simulation is worse than without it."""
        taken = curve_term(self.layout.columns[part.columns[0]], self.layout)
        shapes = part.shapes.shape[1]
        if taken is None or shapes > CURVE_POINTS:
            return None
        by = np.zeros((len(part.shapes), CURVE_POINTS + 1))    # as many for all, so that compiled code is shared
        by[:, :shapes] = part.shapes * part.sd / find_nameless(taken[0]).usual
        return self.along_zero(point, lost, *taken, Curve((0.0,) * CURVE_POINTS, 0.0), by)

    def along_zero(self, point: Point, lost: bool, term: str, values: Mapping[str, float], curve: Curve,
                   by: Float[Array, "n points"]) -> "Carrying[Launcher]":
        """Return the launcher `along` a curve that begins at zero."""
        model = self.along(term, values, curve.moved(dict.fromkeys(curve.fitted, 0.0)), by)
        bare = model.shared_only()
        return Carrying(model, [model.extended(point), *([bare.middle()] if lost else [])])


LauncherFit = Fit[Launcher]
FREE_TERMS = {"launch speed": ("free_speed", {"share": 1.0}),
              "launch elevation": ("free_elevation", {"angle_rad": 1.0}),
              "distance": ("free_distance", {"bias_m": 1.0})}
SIDES = {"along": "along", "vertical": "up", "lateral": "left"}
LONGEST_S = 60.0                      # longer than any flight


def curve_term(column: Column, layout: Layout) -> tuple[str, dict[str, float]] | None:
    """Return the nameless term, with its numbers, that changes what the column does; None if there is none, or the
    layout already has it."""
    if column.name in FREE_TERMS:
        name, values = FREE_TERMS[column.name]
        values = dict(values)
    elif column.name.startswith("push "):
        name, values = "free_push", {"size_m_s2": 1.0, SIDES[column.direction]: 1.0}
        if column.times_s is not None:
            values |= {"from_s": column.times_s[0], "to_s": min(column.times_s[1], LONGEST_S)}
        elif column.follows:
            values |= {"with_speed": 1.0}
    else:
        return None
    return None if name in layout.chain.terms else (name, values)


@cache
def _bounds(slots: tuple[tuple[str, str], ...],
            among: Catalogue) -> tuple[Float[Array, " slots"], Float[Array, " slots"]]:
    """Lowest and highest that a fit may come to. A parameter's declared range, in which it is looked for, goes
    on below zero where its scale does: lift may be reversed, an efficiency above one; drag cannot drive."""
    parameters = [find_parameter(".".join(slot), among) for slot in slots]
    low = [one.low if one.prior is not None and one.prior.scale == LOG else min(one.low, -one.high)
           for one in parameters]
    return np.array(low), np.array([one.high for one in parameters])


def out_of_range(values: Mapping[str, float], among: Catalogue) -> list[str]:
    """Return names ("term.parameter") of values that no fit may reach, or that stopped at their limit; scatters have no
    limit."""
    slots = tuple(tuple(name.split(".", 1)) for name in values if not name.startswith("scatter."))
    low, high = _bounds(slots, among)
    return [".".join(slot) for slot, least, most in zip(slots, low, high, strict=True)
            if not least < values[".".join(slot)] < most]


def stopped(scores: ScoreTable, among: Catalogue) -> dict[str, float]:
    """Return fitted numbers of terms, including a tracker's, and scatters that stopped at the end of their range, by
    name."""
    points = [(one, float(at)) for one, at in zip(scores.columns, scores.point, strict=True) if one.kind != "group"]
    values = {one.name: at for one, at in points if among.get(one.term) is not None}
    found = {name: values[name] for name in out_of_range(values, among)}
    return found | {one.name: float(np.exp(at)) for one, at in points if one.name in END_REPORTED and at >= 1.0}


SCATTERED = {"scatter.speed": ("of the exit speed", "exit speed from shot to shot (sd)"),
             "scatter.elevation_deg": ("deg", "exit angle from shot to shot (sd)")}


@dataclass(frozen=True)
class Sought:
    """One fitted number.

    column: its place in the fit. Its prior has `centre` and `sd` in the parameter's own unit; for a scatter they are
    those of the logarithm, in the column's unit. percent: shown in per cent.
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
        """Return the number for its column at `at`."""
        if not self.scatters:
            return at
        return float(np.degrees(np.exp(at)) if self.name.endswith("_deg") else np.exp(at))

    def at(self, value: float) -> float:
        """Invert `value`."""
        if not self.scatters:
            return value
        return float(np.log(np.radians(value) if self.name.endswith("_deg") else value))

    def improbable(self, value: float) -> bool:
        """Return whether its prior made it all but impossible."""
        return abs(self.at(value) - self.centre) > IMPROBABLE * self.sd

    def slope(self, at: float) -> float:
        """Return d value / d column."""
        return self.value(at) if self.scatters else 1.0


def improbable(layout: Layout, point: Float[np.ndarray, " p"]) -> dict[str, float]:
    """Return the fitted numbers of terms that were all but impossible a priori: {name: value at `point`}."""
    found = {one.name: (one, one.value(float(point[one.column]))) for one in sought_of(layout) if not one.scatters}
    return {name: value for name, (one, value) in found.items() if one.improbable(value)}


def odd_places(scores: ScoreTable, among: Catalogue) -> dict[str, str]:
    """Return {name: remark} of fitted coefficients that lie where physics seldom has them; those that an earlier
    session's data have told are not asked about again.

    These are numbers below the range that their parameter declares (no fit goes above), where the data raise the odds
    of that STRONG times, and numbers so far out in the catalogue's prior that a share ODD of rigs have any.
    """
    asked = [(k, scores.columns[k], one, one.prior) for k in believed_columns(scores, among)
             if among.get(scores.columns[k].term) is not None and not scores.columns[k].told
             and (one := find_parameter(scores.columns[k].name, among)).prior is not None]
    limit = float(ndtri(1.0 - 0.5 * ODD / max(sum(column.kind == "shared" for _, column, *_ in asked), 1)))
    found = {}
    for k, column, one, prior in asked:
        value, places = float(scores.point[k]), [
            (to_scale(prior.scale, number) - to_scale(prior.scale, prior.centre)) / prior.sd
            if fits_scale(prior.scale, number) else -math.inf for number in (one.low, float(scores.point[k]))]
        before, after = ndtr(places[0] / WEAKER), ndtr((one.low - value) / scores.covariance[k, k]**0.5)
        if after > 0.5 and after * (1.0 - before) > STRONG * before * (1.0 - after):
            found[column.name] = f"{column.name} is below {one.low:g} ({value:.3g}), {one.below}"
        elif column.kind == "shared" and limit < abs(places[1]) < math.inf:
            found[column.name] = (f"{column.name} {value:.3g} is {abs(places[1]):.1f} standard deviations from the "
                                  f"usual {prior.centre:g} ({prior.reason}): it may stand for a missing effect")
    return found


def sought_of(layout: Layout) -> tuple[Sought, ...]:
    """Return the numbers of terms, including a tracker's, and of the launch scatter, without random effects and
    scatters that no belief keeps."""
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


def believed_columns(scores: ScoreTable, among: Catalogue) -> list[int]:
    """Return places of the shared columns that belong to a belief: parameters and launch scatters, not random effects
    of balls or a tracker's calibration."""
    return [k for k, column in enumerate(scores.columns[scores.shared], scores.first_shared)
            if column.kind != "group" and not is_tracker(column, among)
            and (column.name in SCATTER_NAMES or not column.name.startswith(SCATTER + "."))]


def coefficients_of(scores: ScoreTable, believed: tuple[str, ...], among: Catalogue) -> Coefficients:
    """Return every believed and named term of the catalogue, with defaults for parameters that were not fitted."""
    tracker = (term.name for term in among if isinstance(term, WatchTerm))
    apart = {*among.always, *tracker, *(term.name for term in NAMELESS)}
    given: Coefficients = {name: {} for name in believed if name not in apart}
    for k in believed_columns(scores, among):
        term, _, parameter = scores.columns[k].name.partition(".")
        if term not in (SCATTER, CURVE):
            given.setdefault(term, {})[parameter] = float(scores.point[k])
    return {name: {key: float(value) for key, value in complete(find_terms([name], among)[0], values).items()}
            for name, values in given.items()}


def scatter_of(scores: ScoreTable) -> dict[str, float]:
    """Return the launch scatters by their names in a belief."""
    found = {column.name: float(np.exp(value)) for column, value in zip(scores.columns, scores.point, strict=True)
             if column.name in SCATTER_NAMES}
    return {SCATTER_NAMES[name]: float(np.degrees(value)) if name.endswith("_rad") else value
            for name, value in found.items()}


def covariance_of(scores: ScoreTable, among: Catalogue) -> tuple[tuple[str, ...], Float[np.ndarray, "p p"]]:
    """Return (names, covariance on their scales); a number outside its scale counts as exact."""
    whole = scores.covariance
    columns = believed_columns(scores, among)
    names = {k: believed_name(scores.columns[k].name) for k in columns}
    kept = [k for k in columns if scores.columns[k].name in SCATTER_NAMES
            or fits_scale(scale_of(names[k], among), float(scores.point[k]))]
    slope = np.array([1.0 / own_slope(scores.columns[k].name, float(scores.point[k]), among) for k in kept])
    return tuple(names[k] for k in kept), whole[np.ix_(kept, kept)] * np.outer(slope, slope)


@dataclass(frozen=True, eq=False)
class MapFit:
    """The fit of `terms` (always including gravity) to a dataset, whose shots are in order."""

    dataset: Dataset
    terms: tuple[str, ...]
    fitted: LauncherFit

    @property
    def scores(self) -> ScoreTable:
        return self.fitted.scores

    @property
    def catalogue(self) -> Catalogue:
        return self.fitted.model.catalogue

    @property
    def converged(self) -> bool:
        return self.fitted.settled

    @property
    def log_posterior(self) -> float:
        """Log posterior at the fit, up to a constant."""
        return self.fitted.log_posterior

    @property
    def at_limit(self) -> dict[str, float]:
        """Fitted numbers that stopped at the end of their range, by name."""
        return stopped(self.scores, self.catalogue)

    @cached_property
    def sought(self) -> tuple[Sought, ...]:
        """The fitted numbers that are reported, including a tracker's errors."""
        return sought_of(self.fitted.model.layout)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of these."""
        return tuple(one.name for one in self.sought)

    @property
    def values(self) -> dict[str, float]:
        """{name: most probable value} of these."""
        return {one.name: one.value(float(self.scores.point[one.column])) for one in self.sought}

    @cached_property
    def covariance(self) -> Float[np.ndarray, "p p"]:
        """Their covariance, in units of their priors' standard deviations: the inverse of prior plus expected
        information."""
        whole = self.scores.covariance
        columns = [one.column for one in self.sought]
        sd = np.array([one.sd for one in self.sought])
        return np.asarray(whole[np.ix_(columns, columns)] / np.outer(sd, sd))

    @cached_property
    def belief(self) -> Belief:
        """Return the belief for forecasts and simulation, without the tracker's errors and random effects."""
        coefficients = coefficients_of(self.scores, self.terms, self.catalogue)
        names, covariance = covariance_of(self.scores, self.catalogue)
        return Belief(coefficients, scatter_of(self.scores), names, covariance, catalogue=self.catalogue)


def fit_map(dataset: Dataset, terms: tuple[str, ...], progress: Progress = lambda done, note: None,
            among: Catalogue | None = None) -> MapFit:
    """Fit the named terms (always including gravity) and the scatter of the launch to a dataset.

    among: the catalogue of the terms, truearc.sim.physics.catalogue.catalogue() by default.

    Deterministic. `converged` is False for a fit that did not converge. InputError: unknown terms, or nothing to fit
    to.
    """
    catalogue = as_catalogue(among)
    catalogue.find(terms)
    names = (*catalogue.always, *(name for name in terms if name not in catalogue.always))
    dataset = dataset.in_order()
    model = Launcher.of(dataset, names, catalogue, fewest=1)
    if not len(model.data.rows):
        why = "; ".join(model.data.left_out) or "there are no shots"
        raise InputError(f"{dataset.shots.source}: there is nothing to fit to, neither a track nor a shot with both a "
                         f"launch and something seen of its flight: {why}")
    return MapFit(dataset, names, fit_believed(model.shared_only(), progress))
