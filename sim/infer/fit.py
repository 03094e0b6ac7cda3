"""The fit of a simulation: its MAP estimate and, at that estimate, the scores of everything the simulation may lack.

A fit owns its model (the simulation and the data to compare it with), its linearization point and the scores there. It
is independent of launchers: truearc.sim.infer.model declares everything that it needs.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Generic

import numpy as np
from jaxtyping import Bool, Float

from truearc.sim.infer.likelihood.score_table import Array, ScoreTable
from truearc.sim.infer.model import AnyModel, Columns, Model, Shape
from truearc.sim.printed import Progress, part_of

ROUNDS = 40                           # of flying, and of steps between two flights
INNER = 10                            # at most each
PATIENCE = 8                          # flights that gain nothing, before what slopes promise is no longer believed
# Source: Nocedal and Wright 2006, algorithm 4.1
POOR, GOOD = 0.25, 0.75               # of the gain that slopes promise: below it steps get shorter, above it longer
HALVINGS = 8                          # of a step at most
SETTLED = 1e-3                        # nats
WORTH = 0.02                          # derived, nats: a move of a fifth of a standard error, 0.2^2 / 2
PART = 0.1                            # of a step that is flown to see whether it gains
LEAST_ROUNDS = 2                      # with samples, whose shots' own deviations must settle too
LARGEST_STEP = 2.0                    # usual sizes that a column may move by in one step: all is linear nearby only
SLACK = 0.3                           # nats a step may lose with samples: scores leave out changes of the spread
NO_FLIGHT = -1e6                      # nats, of what does not fly
# Chosen: 0.3 % of the prior lie beyond
SHAPE_REACH = 3.0                     # standard deviations from a shape parameter's prior centre: the end of the search
# Chosen: about 95 %; a shape is not identified where its term does nothing (Davies 1987)
PLAIN = 2.0                           # standard errors of an amplitude, from which its term's shape is fitted, too


@dataclass(frozen=True)
class Fit(Generic[AnyModel]):
    """A model at its best: `scores` there, of the columns that are fitted and those that are only asked.

    names: columns of terms that `with_terms` has added, the first of the shared ones; amplitude, sd [k]: theirs, of a
    number that was believed its change; log_evidence: nats by which the data favour it over the fit that it was made
    from, size of the amplitude integrated out (Laplace).
    """

    model: AnyModel
    point: Any
    scores: ScoreTable
    names: tuple[str, ...] = ()
    amplitude: Float[Array, " k"] = field(default_factory=lambda: np.zeros(0))
    sd: Float[Array, " k"] = field(default_factory=lambda: np.zeros(0))
    log_evidence: float = 0.0

    @property
    def value(self) -> Float[Array, " k"]:
        """The added numbers [k]."""
        return self.scores.point[:len(self.names)]

    @property
    def wanted(self) -> Float[Array, " k"]:
        """`value`, or where the fit would go if the end of a range did not stop it."""
        scores, k = self.scores, len(self.names)
        step = scores.covariance @ (scores.score.sum(0) + scores.pull)
        return np.asarray(self.value + step[:k])

    @property
    def lost(self) -> bool:
        """Whether it explains nothing: a poor start."""
        return self.model.is_lost(self.point)

    @property
    def log_posterior(self) -> float:
        """Log posterior of shared columns only, up to a constant."""
        return objective(self.scores, self.model.layout)

    @cached_property
    def settled(self) -> bool:
        """Whether no step gains anything significant: neither by slopes nor, for a part of it, when flown.

        For tracks that no flight fits, slopes promise too much, since they ignore their own change.
        """
        bare = self.without_terms()
        step, worth = bare.step(np.full(len(bare.scores.columns), True))
        if worth < WORTH:
            return True
        near = bare.model.about(bare.model.moved(self.point, PART * step))
        there = bare.model.linearise(near)[0]
        return objective(there, bare.model.layout) - bare.log_posterior < max(WORTH, _slack(self.model))

    @property
    def values(self) -> dict[str, float]:
        """Return {shared column: value}, without random effects; scatters themselves, not their logs."""
        first, scores = self.scores.first_shared, self.scores
        return {column.name: float(np.exp(value) if column.name.startswith("scatter.") else value)
                for column, value in zip(scores.columns[first:], scores.point[first:], strict=True)
                if column.kind != "group"}

    def held_out(self) -> Float[Array, " n"]:
        """Return the log score of each shot by fits of the shared columns to the other folds."""
        return self.scores.shared_only().held_out()

    def without_terms(self) -> "Fit[AnyModel]":
        """Return the fit of the shared columns alone, without tested ones."""
        return Fit(self.model.shared_only(), self.point, self.scores.shared_only())

    def with_terms(self, names: tuple[str, ...], start: Float[Array, " k"], near: Any = None) -> "Fit[AnyModel]":
        """Fit the named columns with the shared ones, from amplitudes `start` [k] at this point, or at `near`.

        Shapes of a term are at their likeliest, and their uncertainty is in sd and in log_evidence, where the term does
        enough for that to be identifiable.
        """
        found = self.with_columns(names, start, near)
        if (np.abs(found.amplitude) > PLAIN * found.sd).all():
            for shape in self.model.shapes(names):
                found = self._shaped(shape, found)
        return found

    def with_columns(self, names: tuple[str, ...], start: Float[Array, " k"], near: Any) -> "Fit[AnyModel]":
        """Fit as `with_terms` does, with shapes kept at their values."""
        model, k = self.model.shared_only(names), len(names)
        columns = model.layout.columns
        order = tuple(column.name for column in columns[:k])
        change = np.zeros(len(columns))
        change[:k] = [start[names.index(name)] for name in order]
        tops = [climb(model, model.moved(self.point if near is None else near, change))]
        if near is None and self.lost:
            middle, easier = model.afar(change)
            tops.append(climb_from(model, middle, easier))
        best = max(tops, key=lambda top: top.log_posterior)
        covariance, score = best.scores.covariance, best.scores.score
        # what the shots themselves scatter by, where the model is too sure of itself
        scattered = covariance @ (score.T @ score) @ covariance
        (amplitude, sd), (_, by_shots) = (amplitudes(model.layout, order, best.scores.point, one)
                                          for one in (covariance, scattered))
        return replace(best, names=order, amplitude=amplitude, sd=np.maximum(sd, by_shots),
                       log_evidence=self.nats_for(best))

    def _shaped(self, shape: Shape, found: "Fit[AnyModel]") -> "Fit[AnyModel]":
        """The same with one shape where it is likeliest.

        It is looked for from its prior's centre outwards, then at the top of the parabola through the best three
        places, all in the prior's standard deviations.
        """
        tried: dict[float, Fit[AnyModel]] = {}

        def nats(place: float) -> float:
            tried[place] = self.with_columns(found.names, np.zeros(len(found.names)), shape.put(found.point, place))
            return max(tried[place].log_evidence, NO_FLIGHT) - 0.5 * place**2

        seen = {place: nats(place) for place in (0.0, -1.0, 1.0)}
        while (best := max(seen, key=lambda place: seen[place])) in (min(seen), max(seen)) and abs(best) < SHAPE_REACH:
            further = best + np.copysign(1.0, best)
            seen[further] = nats(further)
        best = min(max(best, min(seen) + 1.0), max(seen) - 1.0)
        left, middle, right = (seen[best + step] for step in (-1.0, 0.0, 1.0))
        bend = max(2.0 * middle - left - right, 1.0)         # no less sure than the prior is
        top = best + float(np.clip(0.5 * (right - left) / bend, -1.0, 1.0))
        value = nats(top)
        moves = (tried[best + 1.0].amplitude - tried[best - 1.0].amplitude) / 2.0
        return replace(tried[top], sd=np.hypot(tried[top].sd, bend**-0.5 * moves),
                       log_evidence=float(value - 0.5 * np.log(bend)))

    def nats_for(self, more: "Fit[AnyModel]") -> float:
        """Return nats by which the data favour a fit of more shared columns, at its optimum, over this one's
        (Laplace)."""
        own, theirs = self.model.layout, more.model.layout
        null = self.scores.shared_only()
        info, null_info = more.scores.information + more.scores.precision, null.information + null.precision
        gained = more.log_posterior - objective(null, own)
        priors = np.linalg.slogdet(theirs.precision)[1] - np.linalg.slogdet(own.precision)[1]
        nats = float(gained + 0.5 * (priors - np.linalg.slogdet(info)[1] + np.linalg.slogdet(null_info)[1]))
        return nats if np.isfinite(nats) else NO_FLIGHT

    def beside(self, found: "Fit[AnyModel]") -> "Fit[AnyModel]":
        """Return this fit with the terms that `found` has added among the shared columns; all others are tested
        again."""
        model = self.model.sharing(found.names)
        return Fit(model, found.point, model.linearise(found.point)[0])

    def step(self, free: Bool[Array, " P"]) -> tuple[Float[Array, " P"], float]:
        """Return (Fisher scoring step of shared columns alone, its predicted gain in nats); columns that are not `free`
        stay.

        Columns at a limit that would go beyond it stay, so that the others go to the best place given that.
        """
        return _step_within(self.model, self.point, self.scores, free)


def fit_believed(model: AnyModel, progress: Progress = lambda done, note: None) -> Fit[AnyModel]:
    """Fit the shared columns by Newton's method with halved steps, relinearised at every step; the others are
    tested."""
    bare, starts = model.shared_only(), model.starts()
    tops: list[Fit[AnyModel]] = []
    for k, start in enumerate(starts):
        tops.append(climb_from(bare, start, bare.easier(),
                               part_of(progress, 0.9 * k / len(starts), 0.9 / len(starts))))
        if model.has_one_top and not tops[-1].lost:
            break
    point = max(tops, key=lambda top: (not (model.has_one_top and top.lost), top.log_posterior)).point
    progress(0.9, "slopes")
    return Fit(model, point, model.linearise(point)[0])


def climb_from(model: AnyModel, point: Any, easier: Iterable[AnyModel],
               progress: Progress = lambda done, note: None) -> Fit[AnyModel]:
    """Return the optimum that a climb from the point reaches, after climbs over `easier` models."""
    for ground in easier:
        point = climb(ground, point, part_of(progress, 0.0, 0.5)).point
    return climb(model, point, part_of(progress, 0.5, 0.5))


def climb(model: AnyModel, point: Any, progress: Progress = lambda done, note: None,
          held: Bool[Array, " P"] | None = None) -> Fit[AnyModel]:
    """Climb in all columns of the model, which must all be shared, until a step is far below their deviations.

    Between flights everything is taken as linear; each optimum found is flown again, until it stays. Columns that are
    `held` stay where they are.
    """
    free = np.full(len(model.layout.columns), True) if held is None else ~held
    highest, idle, reach, gain = -np.inf, 0, np.inf, 0.0
    kept: _Visited[AnyModel] | None = None
    for number in range(ROUNDS):
        progress(number / ROUNDS, "fit")
        flown = model.fly(point)
        fit = Fit(model, point, model.linearise(point, flown)[0])
        here = _Visited(fit, flown, fit.log_posterior)
        idle = 0 if here.value > highest + _slack(model) else idle + 1
        highest = max(highest, here.value)
        if idle > PATIENCE:
            break
        gained = -np.inf if kept is None else here.value - kept.value
        if kept is not None and gained < POOR * gain:         # flights bend more than was allowed for
            usual = [column.usual for column in model.layout.columns]
            reach = 0.5 * float(np.abs((kept.fit.scores.point - fit.scores.point) / usual).max(initial=0.0))
        elif gained > GOOD * gain:
            reach *= 2.0
        if kept is None or gained >= -_slack(model):
            kept = here
            if number >= LEAST_ROUNDS * model.sampled and fit.step(free)[1] < SETTLED:
                break
        point, gain = _climb_linear(kept, free, reach)
    assert kept is not None
    return kept.fit


@dataclass(frozen=True)
class _Visited(Generic[AnyModel]):
    """A fit on its way with what was flown there, and the log posterior."""

    fit: Fit[AnyModel]
    flown: Any
    value: float


def _climb_linear(start: _Visited[AnyModel], free: Bool[Array, " P"], reach: float) -> tuple[Any, float]:
    """(the top without flying again, nats gained), no column farther from the start than `reach` usual sizes."""
    model, point, best = start.fit.model, start.fit.point, start.value
    usual = np.array([column.usual for column in model.layout.columns])
    scores, top = model.linearise(point, start.flown)
    for _ in range(INNER):
        step, worth = _step_within(model, point, scores, free)
        if worth < SETTLED or not np.isfinite(step).all():
            break
        gone = scores.point - start.fit.scores.point
        room = (reach * usual - np.sign(step) * gone) / np.maximum(abs(step), 1e-300)
        step = step * min(1.0, LARGEST_STEP / max(float(np.abs(step / usual).max(initial=0.0)), 1e-300),
                          max(float(room.min(initial=np.inf)), 0.0))
        for halving in range(HALVINGS):
            tried = model.moved(point, step * 0.5**halving)
            there, found = model.linearise(tried, start.flown)
            value = objective(there, model.layout)
            if value >= best - _slack(model):
                break
        else:
            break
        closer = abs(value - best) < SETTLED and reach < np.inf
        best, point, scores, top = value, tried, there, found
        if closer:
            break
    return top, best - start.value


def newton_step(scores: ScoreTable,
                free: Bool[Array, " P"] | slice = slice(None)) -> tuple[Float[Array, " P"], float]:
    """Return (Fisher scoring step for scores of shared columns only, its predicted gain in nats); columns that are not
    `free` stay."""
    info, slope = scores.information + scores.precision, scores.score.sum(0) + scores.pull
    info, slope, step = info[free][:, free], slope[free], np.zeros(len(slope))
    step[free] = np.linalg.solve(info + 1e-12 * np.diag(np.diag(info) + 1e-12), slope)
    return step, 0.5 * float(step[free] @ slope)


def _step_within(model: Model, point: Any, scores: ScoreTable,
                 free: Bool[Array, " P"]) -> tuple[Float[Array, " P"], float]:
    free = free.copy()
    while True:
        step, worth = newton_step(scores, free)
        out = free & model.leads_out(point, step)
        if not out.any():
            return step, worth
        free &= ~out


def amplitudes(layout: Columns, names: Sequence[str], point: Float[Array, " p"],
               covariance: Float[Array, "p p"]) -> tuple[Float[Array, " k"], Float[Array, " k"]]:
    """Return (amplitudes [k] of shared columns, their standard deviations [k]), given all shared numbers.

    A column of a term is its amplitude. A number that was believed to be N(c, C) and may have changed by d ~ N(0, u^2)
    has a new value v, and, with P the precision of all new values, given v

        d ~ N(u^2 e'P (v - c), u^2 - u^4 e'Pe)
    """
    columns = [column.name for column in layout.columns[layout.first_shared:]]
    places = [columns.index(name) for name in names]
    variance = np.array([layout.changes.get(name, 0.0) for name in names])**2
    changed = variance > 0.0
    slope = np.where(changed[:, None], variance[:, None] * layout.precision[places], np.eye(len(columns))[places])
    left = variance * (1.0 - variance * np.diag(layout.precision)[places])
    amplitude = (slope * (point - np.where(changed[:, None], layout.centre, 0.0))).sum(1)
    spread = np.einsum("kp,pq,kq->k", slope, covariance, slope)
    return amplitude, np.sqrt(np.maximum(left + spread, 0.0))


def objective(scores: ScoreTable, layout: Columns) -> float:
    """Return the log posterior, up to a constant."""
    off = scores.point[len(scores.point) - len(layout.centre):] - layout.centre
    value = float(scores.log_score.sum() - 0.5 * off @ layout.precision @ off)
    return value if np.isfinite(value) else -np.inf


def _slack(model: Model) -> float:
    return SLACK if model.sampled else SETTLED
