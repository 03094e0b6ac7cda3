"""Every question that is asked of the data, in families: terms, free changes over covariates, any pattern at all."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim.discover.covariates import Covariate, Factor, Pair, pair_shapes, test_groups, test_shapes
from sim.discover.evidence import Array, Column, Evidence
from sim.discover.statistics import Scores, efficient_scores
from sim.shots import Shots

MOST_GROUPED = 0.34                   # groups a shot: with fewer than three shots each nothing would be left to ask
MANY = 10.0                           # groups, counted by size, from which they and not the shots hang together
TERMS, FREE, PATTERN = "terms", "free", "pattern"
# How the allowance for false alarms is shared out: a name is worth most, and most of what is left out has one.
ALLOWANCE = {TERMS: 0.6, FREE: 0.3, PATTERN: 0.1}


@dataclass(frozen=True)
class Clusters:
    """What hangs together: `label` [shots] numbers the clusters; `by` ball_id, session or shot."""

    by: str
    label: Array
    count: int


@dataclass(frozen=True)
class Test:
    """One question: does this column's amplitude go with these weights [n]? what None: the same in every shot."""

    __test__ = False                  # not one of pytest's

    family: str
    column: int
    what: Covariate | Factor | Pair | None
    shape: str
    weights: Array


@dataclass(frozen=True)
class Asked:
    """All tests with their scores [G, M]."""

    tests: tuple[Test, ...]
    scores: Scores


def find_clusters(shots: Shots) -> Clusters:
    """What luck holds together once groups have their own effects: each shot by itself."""
    return Clusters("shot", np.arange(len(shots)), len(shots))


def groups_of(shots: Shots, rows: Array) -> tuple[str, Array, int] | None:
    """(what, label [n] of these rows, how many): balls when there are at least ten, else sessions when there are.

    Counted as (sum of sizes)^2 / sum of squares, so that a big group and its crumbs are not many. Many groups differ by
    luck, and that is no finding; with fewer a difference between them counts as one, for it could be known.
    """
    for name in ("ball_id", "session"):
        texts = np.array(shots.text(name))[rows]
        if not any(texts):
            continue
        levels, label, sizes = np.unique(texts, return_inverse=True, return_counts=True)
        if sizes.sum()**2 / (sizes**2).sum() >= MANY and len(levels) <= MOST_GROUPED * len(rows):
            return name, label, len(levels)
    return None


def ask_everything(evidence: Evidence, covariates: Sequence[Covariate], factors: Sequence[Factor],
                   clusters: Clusters, seed: int) -> Asked:
    """All tests that the data can carry; a factor that makes the clusters is not asked about."""
    label = clusters.label[evidence.rows]
    grouped = next((column.name.partition(" ")[0] for column in evidence.columns if column.kind == "group"), "")
    shapes = _shapes(evidence, covariates, [f for f in factors if f.name != grouped])
    ones = np.ones((len(evidence.rows), 1))
    tests: list[Test] = []
    parts: list[Scores] = []
    for number, column in enumerate(evidence.columns[:evidence.first_shared]):
        if column.kind == "term" or column.follows:
            family = TERMS if column.kind == "term" else FREE
            tests.append(Test(family, number, None, "same", ones[:, 0]))
            parts.append(efficient_scores(evidence, number, ones, label, clusters.count))
            continue
        tests += [Test(FREE, number, *shape) for shape in shapes]
        weights = np.stack([shape[2] for shape in shapes], axis=1)
        parts.append(efficient_scores(evidence, number, weights, label, clusters.count))
    if pairs := pair_shapes(covariates, evidence.rows, seed):
        number = evidence.index("launch speed")
        tests += [Test(PATTERN, number, *shape) for shape in pairs]
        weights = np.stack([shape[2] for shape in pairs], axis=1)
        parts.append(efficient_scores(evidence, number, weights, label, clusters.count))
    scores = _join(parts)
    kept = np.flatnonzero(scores.kept)
    return Asked(tuple(tests[k] for k in kept), scores.take(kept))


def name_of(test: Test, column: Column) -> str | None:
    """The covariate as reported: what it varies with inside a flight, a column, or nothing."""
    if column.kind == "free" and column.follows:
        return column.follows
    return None if test.what is None else test.what.name


def _join(parts: list[Scores]) -> Scores:
    return Scores(*(np.concatenate([getattr(part, name) for part in parts], axis=-1)
                    for name in ("psi", "kappa", "stretch", "kept")))


def _shapes(evidence: Evidence, covariates: Sequence[Covariate],
            factors: Sequence[Factor]) -> list[tuple[Covariate | Factor | None, str, Array]]:
    shapes: list[tuple[Covariate | Factor | None, str, Array]] = [(None, "same", np.ones(len(evidence.rows)))]
    for covariate in covariates:
        weights, names = test_shapes(covariate, evidence.rows)
        shapes += [(covariate, name, weights[:, k]) for k, name in enumerate(names)]
    for factor in factors:
        weights, names = test_groups(factor, evidence.rows)
        shapes += [(factor, name, weights[:, k]) for k, name in enumerate(names)]
    return shapes

