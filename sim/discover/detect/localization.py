"""Where the disagreement is: which free change carries it, in which stage, over what of covariate and flight."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from truearc.sim.discover.detect.covariates import Covariate, CovariatePair, Factor
from truearc.sim.discover.detect.free_curve import Correction, correct
from truearc.sim.discover.detect.score_test import Judged
from truearc.sim.discover.detect.test_battery import FREE, PATTERN, Asked, Test
from truearc.sim.infer.likelihood.score_table import Array, Column, ScoreTable
from truearc.sim.physics.term import STAGES

AS_GOOD = 0.9                         # of the largest gain: then the plainer description is preferred
SHARE = 0.8                           # of the misfit that region and times must carry
BINS = 6
RESAMPLES = 400


@dataclass(frozen=True)
class Place:
    """Where, without the catalogue: the free change that carries most, and its correction over its covariate.

    `stage_probability`: by the best free change of each stage, on unseen shots.
    """

    test: Test
    column: Column
    number: int                       # of the test
    correction: Correction
    stage_probability: dict[str, float]
    region: dict[str, Any]
    times_s: tuple[float, float] | None


def pick(tests: Sequence[Test], judged: Judged, among: Int[Array, " k"]) -> int:
    """The test that explains most; of those nearly as good the plainest: same for all, then a number, then a group."""
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
    """Take the best free change of every stage, correct by it, and weigh the stages by what that gains held out.

    None where nothing free could be tested.
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
                 for stage in STAGES if (stage_of[free] == stage).any()}
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
    plausible = [-0.5 * (amplitude_of(one) / one.evidence.columns[0].usual) ** 2 for one in corrections.values()]
    power = draws @ totals.T + np.array(plausible)
    share = np.exp(power - power.max(axis=1, keepdims=True))
    mean = (share / share.sum(axis=1, keepdims=True)).mean(axis=0)
    return {stage: float(dict(zip(corrections, mean, strict=True)).get(stage, 0.0)) for stage in STAGES}


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
    """Shortest run of bands of flight time that holds SHARE of what the test's weights explain, band by band."""
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
    """Amplitude of each band when all are fitted at once to shots weighted by `weights` [n] (one for each band)."""
    info = np.einsum("n,nij->ij", weights**2, evidence.info[:, bands][:, :, bands])
    score = weights @ evidence.score[:, bands]
    return np.linalg.solve(info + 1e-9 * np.trace(info) * np.eye(len(bands)), score)


def shortest_run(parts: Float[Array, " parts"]) -> tuple[int, int] | None:
    """(first, last) of the shortest run that holds SHARE of the sum of non-negative parts, the fullest of those."""
    total = parts.sum()
    if total <= 0.0:
        return None
    runs = [(last - first, -parts[first:last + 1].sum(), first, last) for first in range(len(parts))
            for last in range(first, len(parts)) if parts[first:last + 1].sum() >= SHARE * total - 1e-12]
    _, _, first, last = min(runs)
    return first, last


def amplitude_of(correction: Correction) -> float:
    """Size of the effect in the column's unit: how far it changes over the covariate's middle nine tenths.

    The same in every shot: its value. Groups: the largest difference between two. Pairs: between any two shots.
    """
    return float(size_weights(correction) @ correction.amplitude)


def size_weights(correction: Correction) -> Float[Array, " n"]:
    """Weights of the shots' amplitudes in the effect's size."""
    what, amplitude = correction.test.what, correction.amplitude
    if what is None:
        return np.full(len(amplitude), 1.0 / len(amplitude))
    known = np.ones(len(amplitude), dtype=bool)
    if isinstance(what, Covariate):
        values = what.values[correction.evidence.rows]
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
