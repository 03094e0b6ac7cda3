"""Log evidence of hypotheses on the score table: columns times shapes, their sizes integrated out (Laplace).

A hypothesis adds parts to the shared numbers. A part is one column of the table, laid over the shots by shapes whose
coefficients are normal a priori: one shape of ones is a term or a constant push; shapes of a Gaussian process over a
covariate are an unexplained change that goes with it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import block_diag

from truearc.sim.infer.likelihood.score_table import Array, PlaneScores, ScoreTable, fit_linear
from truearc.sim.matrices import invert

KNOTS = 8
LENGTHS = (0.15, 0.4, 1.0)            # of a Gaussian process, as shares of its covariate's range
EDGES = (2.0, 98.0)                   # percentiles: the range
SIZES = (0.5, 1.0, 2.0)               # of a process, by its column's usual amplitude
JITTER = 1e-6


@dataclass(frozen=True)
class Part:
    """A column of the evidence times shapes [n, q], whose coefficients have these standard deviations [q]."""

    column: int
    shapes: Float[Array, "n q"]
    sd: Float[Array, " q"]


def with_parts(evidence: ScoreTable, parts: Sequence[Part]) -> ScoreTable:
    """The table of the parts' coefficients and the shared numbers alone, all shared."""
    first, count = evidence.first_shared, len(evidence.rows)
    rest = np.arange(first, evidence.linear.shape[1])
    own = np.concatenate([*(np.full(part.shapes.shape[1], part.column) for part in parts), rest]).astype(int)
    times = np.concatenate([*(part.shapes for part in parts), np.ones((count, len(rest)))], axis=1)
    more = times.shape[1] - len(rest)
    square = times[:, :, None] * times[:, None, :]
    deal = replace(evidence.deal, real=more + evidence.deal.real - first)
    columns = tuple(replace(evidence.columns[k], kind="shared") for k in own[:more].tolist())
    precision = block_diag(*(np.diag(part.sd**-2.0) for part in parts), evidence.precision)
    return ScoreTable(
        evidence.rows, (*columns, *evidence.columns[first:]), deal,
        np.concatenate([np.zeros(more), evidence.point[first:]]), evidence.linear[:, own] * times,
        evidence.bend[:, own][:, :, own] * square, _plane(evidence.plane, own, times), precision,
        np.concatenate([np.zeros(more), evidence.pull]), evidence.log_score, evidence.own_score[:, own] * times,
        evidence.info[:, own][:, :, own] * square)


def _plane(plane: PlaneScores | None, own: Int[Array, " c"], times: Float[Array, "n c"]) -> PlaneScores | None:
    if plane is None:
        return None
    mine = times[plane.rows]
    return replace(plane, by_column=plane.by_column[:, own] * mine, wider_by=plane.wider_by[:, own] * mine,
                   log_spread_by=plane.log_spread_by[:, own] * mine)


def log_evidence(table: ScoreTable) -> tuple[float, Float[Array, " P"], Float[Array, " P"]]:
    """(nats of a table whose columns are all shared, up to what all tables of one scaffold share; the likeliest
    change [P]; its standard deviations [P])."""
    rows = np.ones(len(table.rows), dtype=bool)
    top = fit_linear(table, rows)
    change = np.tile(top, (len(rows), 1))
    value = table.gain(change).sum() + table.pull @ top - 0.5 * top @ table.precision @ top
    info = table.deal.total(table.slopes_at(change)[1]) + table.precision
    volume = np.linalg.slogdet(table.precision)[1] - np.linalg.slogdet(info)[1]
    sd = np.sqrt(np.maximum(np.diag(invert(info)), 0.0))
    return float(value + 0.5 * volume), top, sd


def process_shapes(values: Float[Array, " n"], length: float,
                   at: Float[Array, " m"] | None = None) -> Float[Array, "m q"]:
    """Shapes of a Gaussian process of variance 1 over values in EDGES (0 where unknown), less their mean; the same
    `at` other values, if given."""
    known = np.isfinite(values)
    low, high = np.percentile(values[known], EDGES)
    knots = np.linspace(0.0, 1.0, KNOTS)

    def kernel(a: Float[Array, " n"], b: Float[Array, " m"]) -> Float[Array, "n m"]:
        return np.asarray(np.exp(-0.5 * ((a[:, None] - b[None, :]) / length)**2))

    size, turn = np.linalg.eigh(kernel(knots, knots) + JITTER * np.eye(KNOTS))
    def shapes(x: Float[Array, " n"]) -> Float[Array, "n q"]:
        place = np.clip((x - low) / max(high - low, 1e-12), 0.0, 1.0)
        return np.asarray(kernel(place, knots) @ (turn * size**-0.5)[:, size > 1e-4])

    wanted = values if at is None else at
    return np.asarray(np.nan_to_num(shapes(wanted) - shapes(values[known]).mean(0)))


def group_shapes(codes: Int[Array, " n"], levels: int) -> Float[Array, "n q"]:
    """One shape a group (-1: none), less their mean."""
    shapes = (codes[:, None] == np.arange(levels)) * 1.0
    return np.asarray(np.where((codes >= 0)[:, None], shapes - shapes[codes >= 0].mean(0), 0.0))


@dataclass(frozen=True)
class Projected:
    """Score [q] and information [q, q] of a column's shapes with what the shared numbers explain taken out."""

    score: Float[Array, " q"]
    info: Float[Array, "q q"]

    def nats(self, sd: float) -> float:
        """Log evidence of normal coefficients of this deviation against none, in closed form."""
        return _gained(self.score, self.info, sd**2 * np.eye(len(self.score)))

    def nats_since(self, home: "Projected", sd: float) -> float:
        """Log evidence that the coefficients have changed since an earlier session by this deviation; what they were
        there, known by its scores and as large before these, may be here, too."""
        covariance = np.linalg.inv(home.info + sd**-2.0 * np.eye(len(self.score)))
        left = self.score - self.info @ covariance @ home.score
        changed = covariance + sd**2 * np.eye(len(self.score))
        return _gained(left, self.info, changed) - _gained(left, self.info, covariance)


def _gained(score: Float[Array, " q"], info: Float[Array, "q q"], covariance: Float[Array, "q q"]) -> float:
    """Log evidence of normal coefficients about 0 against none."""
    inner = np.eye(len(score)) + covariance @ info
    return float(0.5 * score @ np.linalg.solve(inner, covariance @ score) - 0.5 * np.linalg.slogdet(inner)[1])


class Projector:
    """Projects a table's columns, the shared ones' information inverted once."""

    def __init__(self, evidence: ScoreTable) -> None:
        self._evidence = evidence
        shared = evidence.shared
        self._inner = invert(evidence.information[shared, shared] + evidence.precision)
        self._score = evidence.score[:, shared].sum(0) + evidence.pull

    def of(self, column: int, shapes: Float[Array, "n q"]) -> Projected:
        """Of a column times shapes."""
        evidence = self._evidence
        own = evidence.own_score[:, column]
        cross = shapes.T @ evidence.deal.spread(evidence.info[:, column])[:, evidence.shared]
        lift = cross @ self._inner
        info = np.einsum("nq,nr,n->qr", shapes, shapes, evidence.info[:, column, column])
        return Projected(shapes.T @ own - lift @ self._score, info - lift @ cross.T)
