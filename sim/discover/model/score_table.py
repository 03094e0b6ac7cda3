"""What the recordings say about every way in which the simulation could be wrong, one row a shot.

A column is one number that the simulation could be wrong by: a parameter of a term, a deviation of the launch, a free
push, or something fitted (a coefficient, a scatter) that all shots share. Evidence holds the log-likelihood's slope and
curvature in all columns, each shot's own unknowns (how it left, its noise) already integrated out. Everything after
that (tests, place, names) needs no physics.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from truearc.sim.discover.model import plane_likelihood as outcomes
from truearc.sim.discover.model.grouped_columns import GroupedColumns
from truearc.sim.discover.model.plane_likelihood import OutcomeObservations

Array = np.ndarray
FLOOR_M = 0.005                       # of the height's spread: what the model leaves out even of a perfect shot


@dataclass(frozen=True)
class Column:
    """One way to be wrong. `direction`: along (the velocity), vertical (across it, up), lateral (left).

    kind: "term" (a term's amplitude), "free" (a deviation or push, which nobody has named) or "shared" (fitted).
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
    told: bool = False                # of a shared one: an earlier session said how large it is, and how surely


@dataclass(frozen=True)
class PlaneScores:
    """Heights at the plane of m of the n shots (`rows`), normal: mean and spread [m] in m above the target's centre.

    by_column [m, C]: of the mean; wider_by [m, C]: metres by which borders move outwards; log_spread_by [m, C].
    """

    rows: Int[Array, " m"]
    seen: OutcomeObservations
    mean_m: Float[Array, " m"]
    spread_m: Float[Array, " m"]
    by_column: Float[Array, "m C"]
    wider_by: Float[Array, "m C"]
    log_spread_by: Float[Array, "m C"]

    def moved(self, change: Float[Array, "n C"]) -> tuple[OutcomeObservations, Float[Array, " m"], Float[Array, " m"]]:
        """(seen, mean, spread) after `change` [n, C]."""
        mine = change[self.rows]
        mean, wider, log_spread = (np.einsum("mp,mp->m", mine, by)
                                   for by in (self.by_column, self.wider_by, self.log_spread_by))
        seen = outcomes.widened(self.seen, wider) if wider.any() else self.seen
        return seen, self.mean_m + mean, self.spread_m * np.exp(np.clip(log_spread, -2.0, 2.0))


@dataclass(frozen=True)
class ScoreTable:
    """Slopes and curvatures about one point; n shots, P columns, the shared ones last.

    Each shot speaks of C columns of its own, as the `deal` has it: all but those of other groups. `own_score` [n, C] is
    the slope of its log-likelihood, `info` [n, C, C] its expected negative curvature. Of these the part of tracks and
    measured exits is `linear` and `bend`, exact for what follows; that of the plane is worked out anew wherever it is
    asked for. `precision` [p, p] and `pull` [p]: the shared columns' log prior; `log_score` [n]. `point` [P]: the
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

    @cached_property
    def score(self) -> Float[Array, "n P"]:
        """Slope [n, P] of each shot's log-likelihood."""
        return self.deal.spread(self.own_score)

    @cached_property
    def information(self) -> Float[Array, "P P"]:
        """What all shots say together [P, P], without the prior."""
        return self.deal.total(self.info)

    def index(self, name: str) -> int:
        return next(k for k, column in enumerate(self.columns) if column.name == name)

    def told_by(self, rows: Sequence[int] | Int[Array, " k"]) -> Float[Array, "P P"]:
        """The information [P, P] of these shots."""
        chosen = np.asarray(rows)
        return self.deal.some(chosen).total(self.info[chosen])

    def gain(self, change: Float[Array, "n P"]) -> Float[Array, " n"]:
        """Log-likelihood gained by each shot [n] when columns change by `change` [n, P]; heights linear in it."""
        own = self.deal.own(change)
        value: Array = np.einsum("ni,ni->n", self.linear, own) - 0.5 * np.einsum("ni,nij,nj->n", own, self.bend, own)
        if self.plane is not None:
            plane = self.plane
            before = outcomes.log_likelihood(plane.seen, plane.mean_m, plane.spread_m)
            value[plane.rows] += outcomes.log_likelihood(*plane.moved(own)) - before
        return value

    def heights(self, change: Float[Array, "n P"]) -> tuple[OutcomeObservations, Float[Array, " m"], Float[Array, " "
                                                                                                                  "m"]]:
        """(seen, mean, spread) at the plane after `change` [n, P]; there must be one."""
        assert self.plane is not None
        return self.plane.moved(self.deal.own(change))

    def slopes_at(self, change: Float[Array, "n P"]) -> tuple[Float[Array, "n C"], Float[Array, "n C C"]]:
        """Own score [n, C] and information [n, C, C] after `change` [n, P]."""
        own = self.deal.own(change)
        score = self.linear - np.einsum("nij,nj->ni", self.bend, own)
        if self.plane is None:
            return score, self.bend
        return score, _with_plane(self.plane, self.plane.moved(own), score, self.bend)

    def moved(self, change: Float[Array, "n P"]) -> "ScoreTable":
        """The same about the point moved by `change` [n, P], heights and tracks taken as linear on the way."""
        score, info = self.slopes_at(change)
        plane, own = self.plane, self.deal.own(change)
        if plane is not None:
            seen, mean_m, spread_m = plane.moved(own)
            plane = replace(plane, seen=seen, mean_m=mean_m, spread_m=spread_m)
        linear = self.linear - np.einsum("nij,nj->ni", self.bend, own)
        return replace(self, linear=linear, plane=plane, log_score=self.log_score + self.gain(change), own_score=score,
                       info=info)

    def pick(self, kept: Int[Array, " k"]) -> "ScoreTable":
        """With these columns only, in this order; the shared ones must all be kept, and last."""
        deal, own = self.deal.pick(kept)
        plane = self.plane
        if plane is not None:
            plane = replace(plane, by_column=plane.by_column[:, own], wider_by=plane.wider_by[:, own],
                            log_spread_by=plane.log_spread_by[:, own])
        square = np.ix_(np.arange(len(self.bend)), own, own)
        return ScoreTable(self.rows, tuple(self.columns[k] for k in kept), deal, self.point[kept], self.linear[:, own],
                        self.bend[square], plane, self.precision, self.pull, self.log_score, self.own_score[:, own],
                        self.info[square])


def make_evidence(rows: Int[Array, " n"], columns: tuple[Column, ...], point: Float[Array, " P"],
                  linear: Float[Array, "n C"], bend: Float[Array, "n C C"], plane: PlaneScores | None,
                  precision: Float[Array, "p p"], pull: Float[Array, " p"], log_linear: Float[Array, " n"],
                  deal: GroupedColumns | None = None) -> ScoreTable:
    """Put the parts together; log_linear [n]: log-likelihood of tracks and exits. No deal: all columns are everyone's.
    """
    score, info, log_score = linear.copy(), bend, log_linear.copy()
    if plane is not None:
        info = _with_plane(plane, (plane.seen, plane.mean_m, plane.spread_m), score, bend)
        log_score[plane.rows] += outcomes.log_likelihood(plane.seen, plane.mean_m, plane.spread_m)
    deal = deal or GroupedColumns.plain(len(rows), len(columns))
    return ScoreTable(rows, columns, deal, point, linear, bend, plane, precision, pull, log_score, score, info)


def _with_plane(plane: PlaneScores, there: tuple[OutcomeObservations, Float[Array, " m"], Float[Array, " m"]],
                score: Float[Array, "n C"], bend: Float[Array, "n C C"]) -> Float[Array, "n C C"]:
    """What the plane says `there` added to the score, in place, and to the information, which comes back."""
    more, inner = plane_terms(plane, *there)
    info = bend.copy()
    score[plane.rows] += more
    info[plane.rows] += inner
    return info


def plane_terms(plane: PlaneScores, seen: OutcomeObservations, mean_m: Float[Array, " m"],
                spread_m: Float[Array, " m"]) -> tuple[Float[Array, "m C"], Float[Array, "m C C"]]:
    """Score and expected information of what was seen at the plane."""
    by_mean, by_log, by_width = outcomes.slopes(seen, mean_m, spread_m)
    score = (by_mean[:, None] * plane.by_column + by_log[:, None] * plane.log_spread_by
             + by_width[:, None] * plane.wider_by)
    carry = np.stack([plane.by_column, plane.log_spread_by, plane.wider_by], axis=1)
    inner = outcomes.information(seen, mean_m, spread_m)
    return score, np.swapaxes(carry, 1, 2) @ (inner @ carry)


def shared_columns(evidence: ScoreTable) -> slice:
    """Columns of the shared parameters in score and info."""
    return slice(evidence.first_shared, None)
