"""What the recordings say about every way in which the simulation could be wrong, one row a shot.

A column is one number that the simulation could be wrong by: a parameter of a term, a deviation of the launch, a free
push, or something fitted (a coefficient, a scatter) that all shots share. Evidence holds the log-likelihood's slope and
curvature in all columns, each shot's own unknowns (how it left, its noise) already integrated out. Everything after
that (tests, place, names) needs no physics.
"""

from dataclasses import dataclass, replace

import numpy as np

from sim.discover import outcomes
from sim.discover.outcomes import Seen

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
class Plane:
    """Heights at the plane of m of the n shots (`rows`), normal: mean and spread [m] in m above the target's centre.

    by_column [m, P]: of the mean; wider_by [m, P]: metres by which borders move outwards; log_spread_by [m, P].
    """

    rows: Array
    seen: Seen
    mean_m: Array
    spread_m: Array
    by_column: Array
    wider_by: Array
    log_spread_by: Array

    def moved(self, change: Array) -> tuple[Seen, Array, Array]:
        """(seen, mean, spread) after `change` [n, P]."""
        mine = change[self.rows]
        mean, wider, log_spread = (np.einsum("mp,mp->m", mine, by)
                                   for by in (self.by_column, self.wider_by, self.log_spread_by))
        seen = outcomes.widened(self.seen, wider) if wider.any() else self.seen
        return seen, self.mean_m + mean, self.spread_m * np.exp(np.clip(log_spread, -2.0, 2.0))


@dataclass(frozen=True)
class Evidence:
    """Slopes and curvatures about one point; n shots, P columns, the shared ones last.

    `score` [n, P] slope of each shot's log-likelihood, `info` [n, P, P] its expected negative curvature. Of these the
    part of tracks and measured exits is `linear` and `bend`, exact for what follows; that of the plane is worked out
    anew wherever it is asked for. `precision` [p, p] and `pull` [p]: the shared columns' log prior; `log_score` [n].
    `point` [P]: the columns' values where this was made (free ones: 0).
    """

    rows: Array
    columns: tuple[Column, ...]
    point: Array
    linear: Array
    bend: Array
    plane: Plane | None
    precision: Array
    pull: Array
    log_score: Array
    score: Array
    info: Array

    @property
    def first_shared(self) -> int:
        return len(self.columns) - len(self.precision)

    def index(self, name: str) -> int:
        return next(k for k, column in enumerate(self.columns) if column.name == name)

    def gain(self, change: Array) -> Array:
        """Log-likelihood gained by each shot [n] when columns change by `change` [n, P]; heights linear in it."""
        value = (np.einsum("ni,ni->n", self.linear, change)
                 - 0.5 * np.einsum("ni,nij,nj->n", change, self.bend, change))
        if self.plane is not None:
            plane = self.plane
            before = outcomes.log_likelihood(plane.seen, plane.mean_m, plane.spread_m)
            value[plane.rows] += outcomes.log_likelihood(*plane.moved(change)) - before
        return value

    def slopes_at(self, change: Array) -> tuple[Array, Array]:
        """Score [n, P] and information [n, P, P] after `change`."""
        score = self.linear - np.einsum("nij,nj->ni", self.bend, change)
        if self.plane is None:
            return score, self.bend
        more, inner = plane_terms(self.plane, *self.plane.moved(change))
        info = self.bend.copy()
        score[self.plane.rows] += more
        info[self.plane.rows] += inner
        return score, info

    def moved(self, change: Array) -> "Evidence":
        """The same about the point moved by `change` [n, P], heights and tracks taken as linear on the way."""
        score, info = self.slopes_at(change)
        plane = self.plane
        if plane is not None:
            seen, mean_m, spread_m = plane.moved(change)
            plane = replace(plane, seen=seen, mean_m=mean_m, spread_m=spread_m)
        linear = self.linear - np.einsum("nij,nj->ni", self.bend, change)
        return replace(self, linear=linear, plane=plane, log_score=self.log_score + self.gain(change), score=score,
                       info=info)

    def pick(self, kept: Array) -> "Evidence":
        """With these columns only, in this order; the shared ones must all be kept, and last."""
        plane = self.plane
        if plane is not None:
            plane = replace(plane, by_column=plane.by_column[:, kept], wider_by=plane.wider_by[:, kept],
                            log_spread_by=plane.log_spread_by[:, kept])
        square = np.ix_(range(len(self.bend)), kept, kept)
        return Evidence(self.rows, tuple(self.columns[k] for k in kept), self.point[kept], self.linear[:, kept],
                        self.bend[square], plane, self.precision, self.pull, self.log_score, self.score[:, kept],
                        self.info[square])


def make_evidence(rows: Array, columns: tuple[Column, ...], point: Array, linear: Array, bend: Array,
                  plane: Plane | None, precision: Array, pull: Array, log_linear: Array) -> Evidence:
    """Put the parts together; log_linear [n]: log-likelihood of tracks and exits."""
    score, info, log_score = linear.copy(), bend, log_linear.copy()
    if plane is not None:
        more, inner = plane_terms(plane, plane.seen, plane.mean_m, plane.spread_m)
        info = bend.copy()
        score[plane.rows] += more
        info[plane.rows] += inner
        log_score[plane.rows] += outcomes.log_likelihood(plane.seen, plane.mean_m, plane.spread_m)
    return Evidence(rows, columns, point, linear, bend, plane, precision, pull, log_score, score, info)


def plane_terms(plane: Plane, seen: Seen, mean_m: Array, spread_m: Array) -> tuple[Array, Array]:
    """Score [m, P] and expected information [m, P, P] of what was seen at the plane."""
    by_mean, by_log, by_width = outcomes.slopes(seen, mean_m, spread_m)
    score = (by_mean[:, None] * plane.by_column + by_log[:, None] * plane.log_spread_by
             + by_width[:, None] * plane.wider_by)
    carry = np.stack([plane.by_column, plane.log_spread_by, plane.wider_by], axis=1)
    inner = outcomes.information(seen, mean_m, spread_m)
    return score, np.swapaxes(carry, 1, 2) @ (inner @ carry)


def shared_columns(evidence: Evidence) -> slice:
    """Columns of the shared parameters in score and info."""
    return slice(evidence.first_shared, None)
