"""Fits to some of the shots without flying again, and what they say of the others."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float, Int

from truearc.sim.infer.likelihood.score_table import Array, ScoreTable

FOLDS = 5
STEPS = 12
HALVINGS = 6


def unseen_score(evidence: ScoreTable) -> Float[Array, " n"]:
    """Log score of each shot by fits of all columns to the other folds."""
    return np.asarray(evidence.log_score + evidence.gain(unseen_change(evidence)))


def unseen_change(evidence: ScoreTable) -> Float[Array, "n P"]:
    """For each shot the change of all columns, fitted to the other folds."""
    return by_folds(evidence, lambda train: np.tile(fit_linear(evidence, train), (len(train), 1)))


def by_folds(evidence: ScoreTable, fit: Callable[[Bool[Array, " n"]], Float[Array, "n P"]]) -> Float[Array, "n P"]:
    """For each shot its part of what `fit` makes of the shots in the other folds."""
    fold = folds_of(len(evidence.rows))
    change = np.zeros((len(fold), len(evidence.columns)))
    for held in range(fold.max() + 1):
        change[fold == held] = fit(fold != held)[fold == held]
    return change


def folds_of(shots: int) -> Int[Array, " n"]:
    """The fold of each shot: every fifth one, so that each fold sees the whole session."""
    return np.arange(shots) % FOLDS


def fit_linear(evidence: ScoreTable, train: Bool[Array, " n"], start: Float[Array, " P"] | None = None,
               free: Bool[Array, " P"] | slice = slice(None)) -> Float[Array, " P"]:
    """Most probable change of all columns, which must all be shared, given the shots in `train`.

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
    """Gained by a change of all columns, by the shots in `train`; heights and tracks are linear in it."""
    gained = evidence.gain(np.tile(change, (len(evidence.rows), 1)))[train].sum()
    return float(gained + evidence.pull @ change - 0.5 * change @ evidence.precision @ change)


def go_uphill(found: Float[Array, " k"], step_from: Callable[[Float[Array, " k"]], Float[Array, " k"]],
              value_at: Callable[[Float[Array, " k"]], float], steps: int, halvings: int,
              enough: float) -> Float[Array, " k"]:
    """Steps from `found`, whose value is 0, each halved until it gains; ends with one that gains less than `enough`."""
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
    """Standard error of the mean of values [n] that are correlated inside the clusters `label` [n]."""
    sums = np.zeros(label.max() + 1)
    np.add.at(sums, label, values - values.mean())
    count = len(np.unique(label))
    return float(np.sqrt((sums**2).sum() * count / max(count - 1, 1)) / len(values))


def without(evidence: ScoreTable) -> ScoreTable:
    """The shared columns alone."""
    return evidence.pick(np.arange(evidence.first_shared, len(evidence.columns)))
