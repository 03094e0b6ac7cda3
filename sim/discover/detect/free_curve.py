"""A free smooth correction of one channel over one covariate, and what it gains on shots that it has not seen."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import block_diag

from truearc.sim.discover.detect.covariates import Covariate, CovariatePair, smooth_shapes
from truearc.sim.discover.detect.test_battery import Test
from truearc.sim.discover.detect.weight_functions import STEP
from truearc.sim.infer.likelihood.score_table import Array, ScoreTable, by_folds, go_uphill

Basis = Float[Array, "n q"]           # shapes of an amplitude over the shots
Train = Bool[Array, " n"]             # the shots that are fitted to
STEPS = 8                             # of Fisher scoring; one is exact for Gaussian evidence
HALVINGS = 8
RIDGES = (0.0003, 0.003, 0.03, 0.3, 3.0)      # of bends, relative to what the shots say of them
FIRM = 1e-6                           # of everything else, so that an alias of a coefficient does not run away


@dataclass(frozen=True)
class Correction:
    """Changes of the test's column and the shared ones: for each shot fitted to the other folds.

    evidence: with these columns only.
    """

    test: Test
    evidence: ScoreTable
    amplitude: Float[Array, " n"]     # of the column, fitted to all shots
    before: Float[Array, "n P"]       # held out, shared columns alone refitted
    after: Float[Array, "n P"]
    log_before: Float[Array, " n"]    # held-out log score
    log_after: Float[Array, " n"]

    @property
    def gain(self) -> Float[Array, " n"]:
        gain: Array = self.log_after - self.log_before
        return gain


def correct(evidence: ScoreTable, test: Test) -> Correction:
    """Fit the correction to all shots and to each fold's complement."""
    evidence = evidence.pick(np.array([test.column, *range(evidence.first_shared, len(evidence.columns))]))
    basis = _basis(evidence, test)
    before = by_folds(evidence, lambda train: _fitted(evidence, basis[:, :0], train, 0.0))
    after = by_folds(evidence, lambda train: _fitted(evidence, basis, train, _ridge(evidence, test, basis, train)))
    whole = np.ones(len(basis), dtype=bool)
    found = _fit(evidence, basis, whole, _ridge(evidence, test, basis, whole))
    return Correction(test, evidence, basis @ found[:basis.shape[1]], before, after,
                      evidence.log_score + evidence.gain(before), evidence.log_score + evidence.gain(after))


def curve_of(found: Correction) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """(amplitude less its mean over the shots, its standard deviation) [n], as fitted to all shots.

    By the information at the fit, the ridge as a prior, shared numbers marginalised. The mean is left out: a shared
    number may stand in for it.
    """
    basis, fit, covariance = _estimate(found)
    shape = basis - basis.mean(0)
    return shape @ fit, np.sqrt(np.maximum(np.einsum("nq,qr,nr->n", shape, covariance, shape), 0.0))


def contrast_of(found: Correction, weights: Float[Array, " n"]) -> tuple[float, float]:
    """(sum over the shots of weights x amplitude, its standard deviation), as fitted to all shots."""
    basis, fit, covariance = _estimate(found)
    shape = weights @ basis
    return float(shape @ fit), float(np.sqrt(max(shape @ covariance @ shape, 0.0)))


def _estimate(found: Correction) -> tuple[Basis, Float[Array, " q"], Float[Array, "q q"]]:
    """(basis, its coefficients, their covariance)."""
    evidence, test = found.evidence, found.test
    basis = _basis(evidence, test)
    whole = np.ones(len(basis), dtype=bool)
    ridge = _ridge(evidence, test, basis, whole)
    fit = _fit(evidence, basis, whole, ridge)
    info = _normal(evidence, basis, whole, _spread(evidence, basis, fit))[1]
    penalty = block_diag(np.diag(_penalty(evidence, basis, whole, ridge)), evidence.precision)
    q = basis.shape[1]
    return basis, fit[:q], np.linalg.inv(info + penalty + 1e-12 * np.eye(len(info)))[:q, :q]


def _basis(evidence: ScoreTable, test: Test) -> Float[Array, "n q"]:
    """The same for all; straight in the covariate and its bends, after the step where one was found; or each
    group's difference from the first; or two covariates, their product and the wave that was found."""
    ones = np.ones((len(evidence.rows), 1))
    if test.what is None:
        return ones
    if isinstance(test.what, Covariate):
        step = [test.weights[:, None]] if test.shape.startswith(STEP) else []
        return np.concatenate([ones, *step, smooth_shapes(test.what.values[evidence.rows])], axis=1)
    if isinstance(test.what, CovariatePair):
        a, b = test.what.place
        own = [a * b] if test.shape == "product" else [a * b, test.weights]
        return np.concatenate([ones, np.stack([a, b, *own], axis=1)], axis=1)
    codes = test.what.codes[evidence.rows]
    return np.concatenate([ones] + [(codes == k)[:, None] * 1.0 for k in range(1, len(test.what.levels))], axis=1)


def _fitted(evidence: ScoreTable, basis: Basis, train: Train, ridge: float) -> Float[Array, "n P"]:
    """Most likely change with the first column's amplitude in the span of `basis`, by rows in `train`."""
    return _spread(evidence, basis, _fit(evidence, basis, train, ridge))


def _fit(evidence: ScoreTable, basis: Basis, train: Train, ridge: float) -> Float[Array, " k"]:
    """Coefficients of the basis and changes of the shared columns, likeliest for the rows in `train`."""
    shared = evidence.shared
    q, p = basis.shape[1], evidence.score[:, shared].shape[1]
    penalty = block_diag(np.diag(_penalty(evidence, basis, train, ridge)), evidence.precision)
    slope = np.concatenate([np.zeros(q), evidence.pull])

    def step_from(found: Float[Array, " k"]) -> Float[Array, " k"]:
        score, info = _normal(evidence, basis, train, _spread(evidence, basis, found))
        return np.linalg.solve(info + penalty + 1e-12 * np.eye(q + p), score + slope - penalty @ found)

    def value_at(tried: Float[Array, " k"]) -> float:
        gained = evidence.gain(_spread(evidence, basis, tried))[train].sum()
        return float(gained + slope @ tried - 0.5 * tried @ penalty @ tried)

    return go_uphill(np.zeros(q + p), step_from, value_at, STEPS, HALVINGS, 1e-6)


def _spread(evidence: ScoreTable, basis: Basis, found: Float[Array, " k"]) -> Float[Array, "n P"]:
    """Coefficients of the basis and shared changes -> one change a shot."""
    change = np.zeros_like(evidence.score)
    change[:, 0] = basis @ found[:basis.shape[1]]
    change[:, evidence.shared] = found[basis.shape[1]:]
    return change


def _normal(evidence: ScoreTable, basis: Basis, train: Train,
            change: Float[Array, "n P"]) -> tuple[Float[Array, " k"], Float[Array, "k k"]]:
    """Score and information of basis coefficients and shared parameters at `change`."""
    score, info = (part[train] for part in evidence.slopes_at(change))
    shared, deal = evidence.shared, evidence.deal.some(train)
    shapes = basis[train]
    cross = shapes.T @ deal.spread(info[:, 0])[:, shared]
    top = np.einsum("nq,nr,n->qr", shapes, shapes, info[:, 0, 0])
    return (np.concatenate([shapes.T @ score[:, 0], deal.spread(score)[:, shared].sum(0)]),
            np.block([[top, cross], [cross.T, deal.total(info)[shared, shared]]]))


def _penalty(evidence: ScoreTable, basis: Basis, train: Train, ridge: float) -> Float[Array, " q"]:
    """Ridge on each basis column: firm but tiny, and `ridge` on bends (columns from the third)."""
    said = (basis[train]**2 * evidence.info[train, 0, 0][:, None]).sum(0)
    ridges: Array = said * np.where(np.arange(basis.shape[1]) >= 2, FIRM + ridge, FIRM)
    return ridges


def _ridge(evidence: ScoreTable, test: Test, basis: Basis, train: Train) -> float:
    """The ridge under which the training shots are likeliest, bends integrated out (Laplace, first step); groups: 0."""
    q = basis.shape[1]
    if q <= 2 or not isinstance(test.what, Covariate):
        return 0.0
    score, info = _normal(evidence, basis, train, np.zeros_like(evidence.score))
    score = score + np.concatenate([np.zeros(q), evidence.pull])

    def marginal(ridge: float) -> float:
        bends = _penalty(evidence, basis, train, ridge)
        total = info + block_diag(np.diag(bends), evidence.precision) + 1e-12 * np.eye(len(info))
        volume = np.log(np.maximum(bends, 1e-300)).sum() - np.linalg.slogdet(total)[1]
        return float(0.5 * score @ np.linalg.solve(total, score) + 0.5 * volume)

    return max(RIDGES, key=marginal)
