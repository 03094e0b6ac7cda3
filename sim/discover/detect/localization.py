"""Localization of a mismatch: the free change, stage, covariate and part of the flight in which it appears.

Each place is scored by how much a smooth correction of one channel over one covariate gains on held-out shots.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg import block_diag

from truearc.sim.discover.detect.battery import FREE, PATTERN, Asked, Judged, Test
from truearc.sim.discover.detect.covariates import STEP, Covariate, CovariatePair, Factor, smooth_shapes
from truearc.sim.infer.likelihood.score_table import Array, Column, ScoreTable, by_folds, go_uphill
from truearc.sim.physics.term import STAGES

Basis = Float[Array, "n q"]           # shapes of an amplitude over the shots
Train = Bool[Array, " n"]             # the shots that are fitted to
STEPS = 8                             # of Fisher scoring; one is exact for Gaussian evidence
HALVINGS = 8                          # of a step at most
# A factor of ten apart; the likeliest is taken
RIDGES = (0.0003, 0.003, 0.03, 0.3, 3.0)      # of bends, relative to what the shots say of them
FIRM = 1e-6                           # of everything else, so that an alias of a coefficient does not run away


@dataclass(frozen=True)
class Correction:
    """Changes of the test's column and the shared ones: for each shot, fitted to the other folds.

    evidence: with these columns only.
    """

    test: Test
    scores: ScoreTable
    amplitude: Float[Array, " n"]     # of the column, fitted to all shots
    before: Float[Array, "n P"]       # held out, shared columns alone refitted
    after: Float[Array, "n P"]
    log_before: Float[Array, " n"]    # held-out log score
    log_after: Float[Array, " n"]

    @property
    def gain(self) -> Float[Array, " n"]:
        return np.asarray(self.log_after - self.log_before)


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
    """Return (amplitude minus its mean over the shots, its standard deviation) [n], fitted to all shots.

    Uses the information at the fit with the ridge as a prior and shared numbers marginalised. The mean is omitted,
    since a shared number may replace it.
    """
    basis, fit, covariance = _estimate(found)
    shape = basis - basis.mean(0)
    return shape @ fit, np.sqrt(np.maximum(np.einsum("nq,qr,nr->n", shape, covariance, shape), 0.0))


def contrast_of(found: Correction, weights: Float[Array, " n"]) -> tuple[float, float]:
    """Return (sum over the shots of weights x amplitude, its standard deviation), fitted to all shots."""
    basis, fit, covariance = _estimate(found)
    shape = weights @ basis
    return float(shape @ fit), float(np.sqrt(max(shape @ covariance @ shape, 0.0)))


def _estimate(found: Correction) -> tuple[Basis, Float[Array, " q"], Float[Array, "q q"]]:
    """(basis, its coefficients, their covariance)."""
    evidence, test = found.scores, found.test
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
    return np.asarray(said * np.where(np.arange(basis.shape[1]) >= 2, FIRM + ridge, FIRM))


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


# Derived: as ALIAS of the terms has it, a correlation of 0.95 explains 0.95^2
AS_GOOD = 0.9                         # of the largest gain: then the plainer description is preferred
# Chosen: most of it; the places beside it are in doubt
SHARE = 0.8                           # of the misfit that region and times must carry
BINS = 6                              # chosen: fifty shots of a season each
RESAMPLES = 400                       # a share is known to 2.5 %


@dataclass(frozen=True)
class Place:
    """Location without the catalogue: the free change that explains most, and its correction over its covariate.

    `stage_probability`: from the best free change of each stage, on unseen shots.
    """

    test: Test
    column: Column
    number: int                       # of the test
    correction: Correction
    stage_probability: dict[str, float]
    region: dict[str, Any]
    times_s: tuple[float, float] | None


def pick(tests: Sequence[Test], judged: Judged, among: Int[Array, " k"]) -> int:
    """Return the test that explains most; among nearly equal ones the simplest: constant, then a number, then a
    group."""
    best = judged.gain[among].max()
    good: list[int] = [k for k in among.tolist() if judged.gain[k] >= AS_GOOD * best]
    return min(good, key=lambda k: (_plainness(tests[k]), -judged.gain[k]))


def _plainness(test: Test) -> int:
    if test.what is None:
        return 0
    if isinstance(test.what, Factor | CovariatePair):
        return 3
    return 1 if test.shape in ("straight", "proportional") else 2


def locate(evidence: ScoreTable, asked: Asked, judged: Judged, false_alarm: float, shots: int,
           seed: int) -> Place | None:
    """Correct by the best free change of every stage, and weigh the stages by the gain on held-out shots.

    None if nothing free could be tested.
    """
    tests = asked.tests
    free = np.array([k for k, test in enumerate(tests) if test.family == FREE], dtype=int)
    if not len(free):
        return None
    found = free[judged.p_value[free] <= false_alarm]
    if not len(found):
        found = np.array([k for k, test in enumerate(tests) if test.family == PATTERN
                          and judged.p_value[k] <= false_alarm], dtype=int)
    stage_of = np.array([evidence.columns[test.column].stage for test in tests])
    leader = pick(tests, judged, found if len(found) else free)
    champions = {stage: pick(tests, judged, free[stage_of[free] == stage])
                 for stage in stages_of(evidence) if (stage_of[free] == stage).any()}
    champions[stage_of[leader]] = leader
    corrections = {stage: correct(evidence, tests[k]) for stage, k in champions.items()}
    weights = _weigh(evidence, corrections, shots, seed)
    correction = corrections[stage_of[leader]]
    return Place(tests[leader], evidence.columns[tests[leader].column], leader, correction, weights,
                 _region(evidence, correction), times_of(evidence, tests[leader]))


def _weigh(evidence: ScoreTable, corrections: dict[str, Correction], shots: int, seed: int) -> dict[str, float]:
    """Probability of each stage: held-out gains under resampled shots (pseudo-BMA with a Bayesian bootstrap), each
    stage at a disadvantage the larger its departure would have to be beside what is usual for such a one.

    Outcomes alone often fit a camera that is a metre out as well as a launch that is slow; the first is implausible.
    Yao et al. 2018, Using stacking to average predictive distributions, section 3.4.
    """
    totals = np.zeros((len(corrections), shots))
    totals[:, evidence.rows] = [correction.gain for correction in corrections.values()]
    draws = np.random.default_rng(seed).dirichlet(np.ones(shots), RESAMPLES) * shots
    # log of a normal prior on the departure's size, relative to its peak
    plausible = [-0.5 * (amplitude_of(one) / one.scores.columns[0].usual) ** 2 for one in corrections.values()]
    power = draws @ totals.T + np.array(plausible)
    share, stages = np.exp(power - power.max(axis=1, keepdims=True)), stages_of(evidence)
    mean = (share / share.sum(axis=1, keepdims=True)).mean(axis=0)
    return {stage: float(dict(zip(corrections, mean, strict=True)).get(stage, 0.0)) for stage in stages}


def stages_of(evidence: ScoreTable) -> tuple[str, ...]:
    """Return the stages of a launcher's shot, or those that the columns of another system have."""
    own = dict.fromkeys(column.stage for column in evidence.columns[:evidence.first_shared])
    return STAGES if own.keys() <= {*STAGES} else tuple(own)


def _region(evidence: ScoreTable, correction: Correction) -> dict[str, Any]:
    """Shortest run of the covariate's range that holds SHARE of what the correction gains on unseen shots; {} where it
    gains nothing, or as much everywhere."""
    what = correction.test.what
    if what is None or isinstance(what, CovariatePair) or correction.gain.sum() <= 0.0:
        return {}
    if isinstance(what, Factor):
        return {"factor": what.name, "level": correction.test.shape}
    values = what.values[evidence.rows]
    edges = _bin_edges(values[np.isfinite(values)])
    where = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    gained = np.maximum(np.bincount(where, np.where(np.isfinite(values), correction.gain, 0.0), len(edges) - 1), 0.0)
    run = shortest_run(gained)
    if run is None or run == (0, len(gained) - 1):
        return {}
    first, last = run
    return {"covariate": what.name, "low": float(edges[first]), "high": float(edges[last + 1]),
            "share_of_gain": float(gained[first:last + 1].sum() / gained.sum())}


def _bin_edges(values: Float[Array, " m"]) -> Float[Array, " edges"]:
    """Quantiles, or the distinct values of a covariate with few; the last edge belongs to the last bin."""
    distinct = np.unique(values)
    if len(distinct) <= BINS:
        return np.append(distinct, distinct[-1])
    return np.unique(np.quantile(values, np.linspace(0.0, 1.0, BINS + 1)))


def times_of(evidence: ScoreTable, test: Test) -> tuple[float, float] | None:
    """Return the shortest run of flight-time bands that holds SHARE of what the test's weights explain, band by
    band."""
    channel = evidence.columns[test.column]
    bands = [k for k, other in enumerate(evidence.columns) if other.times_s and other.direction == channel.direction]
    if channel.stage != "flight" or not bands:
        return None
    if channel.times_s:
        return channel.times_s
    amplitude = joint_bands(evidence, bands, test.weights)
    gained = np.array([amplitude[i] * (test.weights * evidence.score[:, k]).sum() for i, k in enumerate(bands)])
    run = shortest_run(np.maximum(gained, 0.0))
    if run is None:
        return None
    first, last = (evidence.columns[bands[k]].times_s for k in run)
    return (first[0], last[1]) if first and last else None


def joint_bands(evidence: ScoreTable, bands: Sequence[int],
                weights: Float[Array, " n"]) -> Float[Array, " bands"]:
    """Return the amplitude of each band, all fitted jointly to shots weighted by `weights` [n] (one per band)."""
    info = np.einsum("n,nij->ij", weights**2, evidence.info[:, bands][:, :, bands])
    return np.linalg.solve(info + 1e-9 * np.trace(info) * np.eye(len(bands)), weights @ evidence.score[:, bands])


def shortest_run(parts: Float[Array, " parts"]) -> tuple[int, int] | None:
    """Return (first, last) of the shortest run with SHARE of the sum of non-negative parts, the fullest of those."""
    total = parts.sum()
    if total <= 0.0:
        return None
    runs = [(last - first, -parts[first:last + 1].sum(), first, last) for first in range(len(parts))
            for last in range(first, len(parts)) if parts[first:last + 1].sum() >= SHARE * total - 1e-12]
    _, _, first, last = min(runs)
    return first, last


def amplitude_of(correction: Correction) -> float:
    """Return the size of the effect in the column's unit: its change over the covariate's middle 90 %.

    For a constant effect, its value. For groups, the largest difference between two; for pairs, between any two shots.
    """
    return float(size_weights(correction) @ correction.amplitude)


def size_weights(correction: Correction) -> Float[Array, " n"]:
    """Return the weights of the shots' amplitudes in the effect's size."""
    what, amplitude = correction.test.what, correction.amplitude
    if what is None:
        return np.full(len(amplitude), 1.0 / len(amplitude))
    known = np.ones(len(amplitude), dtype=bool)
    if isinstance(what, Covariate):
        values = what.values[correction.scores.rows]
        known = np.isfinite(values)
        low, high = np.quantile(values[known], (0.05, 0.95))
        span: Array = _read_at(high, values, known) - _read_at(low, values, known)
        # a bend can bring both ends level: then the height of the bend is the size
        if abs(span @ amplitude) >= 0.5 * np.ptp(amplitude[known]):
            return span
    among, ends = np.flatnonzero(known), np.zeros(len(amplitude))
    ends[among[amplitude[known].argmax()]] += 1.0
    ends[among[amplitude[known].argmin()]] -= 1.0
    return ends


def _read_at(at: float, values: Float[Array, " n"], known: Bool[Array, " n"]) -> Float[Array, " n"]:
    """Weights of the shots when their numbers are interpolated at one value of the covariate."""
    order = np.flatnonzero(known)[np.argsort(values[known], kind="stable")]
    above = min(max(int(np.searchsorted(values[order], at, side="right")), 1), len(order) - 1)
    first, second = order[above - 1], order[above]
    gap = values[second] - values[first]
    share = (at - values[first]) / gap if gap > 0.0 else 0.0
    weights = np.zeros(len(values))
    weights[first], weights[second] = 1.0 - share, share
    return weights
