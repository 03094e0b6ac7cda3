"""The score table: slopes and curvatures of the log-likelihood in every possible error, one row per shot.

A column is one number in which the simulation could be wrong: a parameter of a term, a deviation of the launch, a free
push, or a fitted number that all shots share (a coefficient, a scatter). The unknowns of each shot (its initial
conditions, its noise) are already integrated out. All later steps (tests, localization, names) need no physics.

A random effect, such as that of a ball, belongs to the shots of one group. A shot's rows therefore hold one column per
effect, and GroupedColumns stores its group: with many balls, a matrix over all columns would be mostly zeros.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from truearc.sim.infer.likelihood.outcomes import Outcomes
from truearc.sim.statistics import invert

Array = np.ndarray
Change = Float[Array, " P"]            # of all columns
Which = Bool[Array, " P"]
Centre = Float[Array, " p"]            # of the shared ones
Precision = Float[Array, "p p"]
Seen = tuple[Outcomes, Float[Array, " m"], Float[Array, " m"]]       # with mean and spread of the observable


@dataclass(frozen=True)
class Column:
    """One way to be wrong. `direction`: along (the velocity), vertical (across it, up), lateral (left).

    kind: "term" (a term's amplitude), "free" (a deviation or push that is of no term) or "shared" (fitted).
    `usual`: one standard deviation of what such a departure amounts to, in its unit.
    """

    name: str
    kind: str
    stage: str                        # sensing | launch | flight | arrival
    direction: str
    unit: str                         # of its amplitude
    usual: float
    words: tuple[str, str] = ("more", "less")      # a positive and a negative amplitude, compared with the simulation
    follows: str = ""                 # what it varies with inside one flight; "" = an amplitude a shot
    times_s: tuple[float, float] | None = None
    told: bool = False                # of a shared one: its prior is an earlier session's posterior
    curve: str = ""                   # smooth curve of which this is one of several shapes

    @property
    def term(self) -> str:
        """The name of its term, or its own name without one."""
        return self.name.partition(".")[0]


@dataclass(frozen=True)
class PlaneScores:
    """Observables at the target of m of the n shots (`rows`), normal: mean and spread [m] in m from its centre, such as
    the height at an upright plane.

    by_column [m, C]: of the mean; moved_by [m, moves, C]: of the further numbers of Outcomes, the first of which is
    metres by which borders move outwards; log_spread_by [m, C].
    """

    rows: Int[Array, " m"]
    seen: Outcomes
    mean_m: Float[Array, " m"]
    spread_m: Float[Array, " m"]
    by_column: Float[Array, "m C"]
    moved_by: Float[Array, "m moves C"]
    log_spread_by: Float[Array, "m C"]

    @cached_property
    def log_likelihood(self) -> Float[Array, " m"]:
        return self.seen.log_likelihood(self.mean_m, self.spread_m)

    def moved(self, change: Float[Array, "n C"]) -> Seen:
        """Return (seen, mean, spread) after `change` [n, C]."""
        mine = change[self.rows]
        mean, log_spread, *moved = (np.einsum("mp,mp->m", mine, by) for by in (
            self.by_column, self.log_spread_by, *np.moveaxis(self.moved_by, 1, 0)))
        spread_m = self.spread_m * np.exp(np.clip(log_spread, -2.0, 2.0))
        return self.seen.moved(np.stack(moved, axis=1)), self.mean_m + mean, spread_m


@dataclass(frozen=True)
class GroupedColumns:
    """A shot's own C columns: `real` that all shots have, then its group's `effects`; of P over all groups, which come
    effect by effect, group by group.

    label [n] numbers each shot's group, below `groups`.
    """

    real: int
    effects: int
    groups: int
    label: Int[Array, " n"]

    @staticmethod
    def plain(shots: int, columns: int) -> "GroupedColumns":
        """Return columns of shots without groups."""
        return GroupedColumns(columns, 0, 0, np.zeros(shots, dtype=int))

    @property
    def width(self) -> int:
        """The number P of columns."""
        return self.real + self.effects * self.groups

    @cached_property
    def place(self) -> Int[Array, "n C"]:
        """Return which of the P each of a shot's own columns is [n, C]."""
        common = np.tile(np.arange(self.real), (len(self.label), 1))
        return np.concatenate([common, self.real + np.arange(self.effects) * self.groups + self.label[:, None]], axis=1)

    def own(self, change: Float[Array, "n P"]) -> Float[Array, "n C"]:
        """Return each shot's own columns."""
        return np.take_along_axis(change, self.place, axis=1) if self.effects else change

    def spread(self, own: Float[Array, "n C"]) -> Float[Array, "n P"]:
        """Return all columns, with zero in those of other groups."""
        if not self.effects:
            return own
        spread = np.zeros((len(own), self.width))
        np.put_along_axis(spread, self.place, own, axis=1)
        return spread

    def some(self, rows: Int[Array, " k"] | Bool[Array, " n"]) -> "GroupedColumns":
        """Return the columns of some shots."""
        return replace(self, label=self.label[rows])

    def total(self, own: Float[Array, "n C C"]) -> Float[Array, "P P"]:
        """Return the sum [P, P] over shots of own [n, C, C]."""
        real = self.real
        total = np.zeros((self.width, self.width))
        total[:real, :real] = own[:, :real, :real].sum(0)
        for effect in range(real, real + self.effects):
            np.add.at(total, self.place[:, effect], self.spread(own[:, effect]))
        total[:real, real:] = total[real:, :real].T
        return total

    def pick(self, kept: Int[Array, " k"]) -> tuple["GroupedColumns", Int[Array, " c"]]:
        """Return (deal, which own columns) for these columns, those of all shots first; of groups all or none."""
        real = kept[kept < self.real]
        effects = self.effects if len(kept) > len(real) else 0
        deal = GroupedColumns(len(real), effects, self.groups if effects else 0, self.label)
        return deal, np.concatenate([real, self.real + np.arange(effects)])


@dataclass(frozen=True)
class ScoreTable:
    """Slopes and curvatures about one point; n shots, P columns, the shared ones last.

    Each shot speaks of C columns of its own, as the `deal` has it: all but those of other groups. `own_score` [n, C] is
    the slope of its log-likelihood, `info` [n, C, C] its expected negative curvature. Of these the part of tracks and
    measured exits is `linear` and `bend`, exact for what follows; that of the plane is computed again wherever it is
    needed. `precision` [p, p] and `pull` [p]: the shared columns' log prior; `log_score` [n]. `point` [P]: the
    columns' values where this was made (free ones: 0).
    """

    rows: Int[Array, " n"]
    columns: tuple[Column, ...]
    deal: GroupedColumns
    point: Float[Array, " P"]
    linear: Float[Array, "n C"]
    bend: Float[Array, "n C C"]
    plane: PlaneScores | None
    precision: Float[Array, "p p"]
    pull: Float[Array, " p"]
    log_score: Float[Array, " n"]
    own_score: Float[Array, "n C"]
    info: Float[Array, "n C C"]

    @property
    def first_shared(self) -> int:
        return len(self.columns) - len(self.precision)

    @property
    def shared(self) -> slice:
        """Columns of the shared parameters in score and info."""
        return slice(self.first_shared, None)

    @cached_property
    def score(self) -> Float[Array, "n P"]:
        """Return the slope [n, P] of each shot's log-likelihood."""
        return self.deal.spread(self.own_score)

    @cached_property
    def information(self) -> Float[Array, "P P"]:
        """Return the information of all shots [P, P], without the prior."""
        return self.deal.total(self.info)

    @cached_property
    def covariance(self) -> Float[Array, "P P"]:
        """Return the covariance of all columns, if all are shared: the inverse of information plus prior."""
        return invert(self.information + self.precision)

    @property
    def together(self) -> Int[Array, " n"]:
        """The cluster of each shot [n], within which shots are correlated when figures are compared: its group, or
        itself."""
        return np.arange(len(self.rows)) if self.deal.groups <= 1 else self.deal.label

    def index(self, name: str) -> int:
        return next(k for k, column in enumerate(self.columns) if column.name == name)

    def told_by(self, rows: Sequence[int] | Int[Array, " k"]) -> Float[Array, "P P"]:
        """Return the information [P, P] of these shots."""
        chosen = np.asarray(rows)
        return self.deal.some(chosen).total(self.info[chosen])

    def gain(self, change: Float[Array, "n P"]) -> Float[Array, " n"]:
        """Return the log-likelihood gained by each shot [n] when columns change by `change` [n, P]; heights linear in
        it."""
        own = self.deal.own(change)
        value: Array = np.einsum("ni,ni->n", self.linear, own) - 0.5 * np.einsum("ni,nij,nj->n", own, self.bend, own)
        if self.plane is not None:
            seen, mean_m, spread_m = self.plane.moved(own)
            value[self.plane.rows] += seen.log_likelihood(mean_m, spread_m) - self.plane.log_likelihood
        return value

    def heights(self, change: Float[Array, "n P"]) -> Seen:
        """Return (seen, mean, spread) at the plane, which must exist, after `change` [n, P]."""
        assert self.plane is not None
        return self.plane.moved(self.deal.own(change))

    def slopes_at(self, change: Float[Array, "n P"]) -> tuple[Float[Array, "n C"], Float[Array, "n C C"]]:
        """Return own score [n, C] and information [n, C, C] after `change` [n, P]."""
        own = self.deal.own(change)
        score = self.linear - np.einsum("nij,nj->ni", self.bend, own)
        if self.plane is None:
            return score, self.bend
        return score, _with_plane(self.plane, self.plane.moved(own), score, self.bend)

    def moved(self, change: Float[Array, "n P"]) -> "ScoreTable":
        """Return the table about the point moved by `change` [n, P], with heights and tracks taken as linear."""
        score, info = self.slopes_at(change)
        plane, own = self.plane, self.deal.own(change)
        if plane is not None:
            seen, mean_m, spread_m = plane.moved(own)
            plane = replace(plane, seen=seen, mean_m=mean_m, spread_m=spread_m)
        linear = self.linear - np.einsum("nij,nj->ni", self.bend, own)
        return replace(self, linear=linear, plane=plane, log_score=self.log_score + self.gain(change), own_score=score,
                       info=info)

    def pick(self, kept: Int[Array, " k"]) -> "ScoreTable":
        """Return the table with these columns only, in this order; the shared ones must all be kept, and last."""
        deal, own = self.deal.pick(kept)
        plane = self.plane
        if plane is not None:
            plane = replace(plane, by_column=plane.by_column[:, own], moved_by=plane.moved_by[:, :, own],
                            log_spread_by=plane.log_spread_by[:, own])
        square = np.ix_(np.arange(len(self.bend)), own, own)
        return ScoreTable(self.rows, tuple(self.columns[k] for k in kept), deal, self.point[kept], self.linear[:, own],
                        self.bend[square], plane, self.precision, self.pull, self.log_score, self.own_score[:, own],
                        self.info[square])

    def shared_only(self) -> "ScoreTable":
        """Return the table of the shared columns alone."""
        return self.pick(np.arange(self.first_shared, len(self.columns)))

    def held_out(self) -> Float[Array, " n"]:
        """Return the log score of each shot by fits of all columns, which must all be shared, to the other folds."""
        return np.asarray(self.log_score + self.gain(self.held_out_change()))

    def held_out_change(self) -> Float[Array, "n P"]:
        """Return, for each shot, the change of all columns fitted to the other folds."""
        return by_folds(self, lambda train: np.tile(fit_linear(self, train), (len(train), 1)))


def make_evidence(rows: Int[Array, " n"], columns: tuple[Column, ...], point: Float[Array, " P"],
                  linear: Float[Array, "n C"], bend: Float[Array, "n C C"], plane: PlaneScores | None,
                  precision: Float[Array, "p p"], pull: Float[Array, " p"], log_linear: Float[Array, " n"],
                  deal: GroupedColumns | None = None) -> ScoreTable:
    """Put the parts together; log_linear [n]: log-likelihood of tracks and exits. No deal: all columns are everyone's.
    """
    score, info, log_score = linear.copy(), bend, log_linear.copy()
    if plane is not None:
        info = _with_plane(plane, (plane.seen, plane.mean_m, plane.spread_m), score, bend)
        log_score[plane.rows] += plane.log_likelihood
    deal = deal or GroupedColumns.plain(len(rows), len(columns))
    return ScoreTable(rows, columns, deal, point, linear, bend, plane, precision, pull, log_score, score, info)


def _with_plane(plane: PlaneScores, there: Seen, score: Float[Array, "n C"],
                bend: Float[Array, "n C C"]) -> Float[Array, "n C C"]:
    """Add the plane's part `there` to the score, in place, and to the information, which is returned."""
    more, inner = plane_terms(plane, *there)
    info = bend.copy()
    score[plane.rows] += more
    info[plane.rows] += inner
    return info


def plane_terms(plane: PlaneScores, seen: Outcomes, mean_m: Float[Array, " m"],
                spread_m: Float[Array, " m"]) -> tuple[Float[Array, "m C"], Float[Array, "m C C"]]:
    """Return score and expected information of the observations at the plane."""
    (by_mean, by_log, *by_move), information = seen.slopes_and_information(mean_m, spread_m,
                                                                           np.asarray(plane.moved_by.any((0, 2))))
    score = by_mean[:, None] * plane.by_column + by_log[:, None] * plane.log_spread_by
    for number, by in enumerate(by_move):
        score = score + by[:, None] * plane.moved_by[:, number]
    carry = np.concatenate([np.stack([plane.by_column, plane.log_spread_by], axis=1), plane.moved_by], axis=1)
    return score, np.swapaxes(carry, 1, 2) @ (information @ carry)


# Source: five or ten are a good compromise of bias and variance (Hastie et al. 2009, 7.10)
FOLDS = 5
STEPS = 12                            # of Fisher scoring at most,
HALVINGS = 6                          # each halved so often at most


def by_folds(evidence: ScoreTable, fit: Callable[[Bool[Array, " n"]], Float[Array, "n P"]]) -> Float[Array, "n P"]:
    """Return, for each shot, its part of the result of `fit` on the shots of the other folds."""
    fold = folds_of(len(evidence.rows))
    change = np.zeros((len(fold), len(evidence.columns)))
    for held in range(fold.max() + 1):
        change[fold == held] = fit(fold != held)[fold == held]
    return change


def folds_of(shots: int) -> Int[Array, " n"]:
    """Return the fold of each shot: every fifth one, so that each fold covers the whole session."""
    return np.arange(shots) % FOLDS


def fit_linear(evidence: ScoreTable, train: Bool[Array, " n"], start: Float[Array, " P"] | None = None,
               free: Bool[Array, " P"] | slice = slice(None)) -> Float[Array, " P"]:
    """Return the most probable change of all columns, which must all be shared, given the shots in `train`.

    start: [P] where to begin; columns that are not `free` stay there.
    """
    n, deal = len(evidence.rows), evidence.deal.some(train)
    begin = np.zeros(len(evidence.columns)) if start is None else start

    def step_from(found: Float[Array, " P"]) -> Float[Array, " P"]:
        score, info = evidence.slopes_at(np.tile(found, (n, 1)))
        slope = deal.spread(score[train]).sum(0) + evidence.pull - evidence.precision @ found
        step = np.zeros(len(slope))
        step[free] = np.linalg.solve((deal.total(info[train]) + evidence.precision)[free][:, free], slope[free])
        return step

    def value_at(tried: Float[Array, " P"]) -> float:
        return log_posterior(evidence, tried, train) - before

    before = 0.0
    before = value_at(begin)
    return go_uphill(begin, step_from, value_at, STEPS, HALVINGS, 1e-5)


def log_posterior(evidence: ScoreTable, change: Float[Array, " P"], train: Bool[Array, " n"] | slice) -> float:
    """Return the gain of the log posterior by a change of all columns, from the shots in `train`; heights and tracks
    are linear in it."""
    gained = evidence.gain(np.tile(change, (len(evidence.rows), 1)))[train].sum()
    return float(gained + evidence.pull @ change - 0.5 * change @ evidence.precision @ change)


def go_uphill(found: Float[Array, " k"], step_from: Callable[[Float[Array, " k"]], Float[Array, " k"]],
              value_at: Callable[[Float[Array, " k"]], float], steps: int, halvings: int,
              enough: float) -> Float[Array, " k"]:
    """Step from `found`, whose value is 0, halving each step until it gains; stop at a gain of less than `enough`."""
    best = 0.0
    for _ in range(steps):
        step = step_from(found)
        for halving in range(halvings):
            tried = found + step * 0.5**halving
            value = value_at(tried)
            if value >= best:
                break
        else:
            break
        small, found, best = value - best < enough, tried, value
        if small:
            break
    return found


def clustered_error(values: Float[Array, " n"], label: Int[Array, " n"]) -> float:
    """Return the standard error of the mean of values [n] that are correlated within the clusters `label` [n]."""
    sums = np.zeros(label.max() + 1)
    np.add.at(sums, label, values - values.mean())
    count = len(np.unique(label))
    return float(np.sqrt((sums**2).sum() * count / max(count - 1, 1)) / len(values))
