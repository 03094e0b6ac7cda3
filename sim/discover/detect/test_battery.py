"""Every test of the data, in families: terms, free changes over covariates, any pattern at all."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from truearc.sim.discover.detect import weight_functions as functions
from truearc.sim.discover.detect.covariates import Covariate, CovariatePair, Factor
from truearc.sim.discover.detect.reference_session import ReferenceSession
from truearc.sim.discover.detect.score_test import Scores, efficient_scores
from truearc.sim.discover.detect.weight_functions import SAME, Look, WeightFunction, weights_of
from truearc.sim.infer.likelihood.score_table import Array, Column, ScoreTable

TERMS, FREE, PATTERN = "terms", "free", "pattern"
# How the allowance for false alarms is shared out: a name is worth most, and most of what is left out has one.
ALLOWANCE = {TERMS: 0.6, FREE: 0.3, PATTERN: 0.1}


@dataclass(frozen=True)
class Test:
    """One question: does this column's amplitude go with these weights [n]? what None: the same in every shot."""

    __test__ = False                  # not one of pytest's

    family: str
    column: int
    what: Covariate | Factor | CovariatePair | None
    shape: str
    weights: Float[Array, " n"]
    form: WeightFunction = SAME                # behind `shape` and `weights`, to lay over another session


@dataclass(frozen=True)
class Asked:
    """All tests with their scores [G, M]."""

    tests: tuple[Test, ...]
    scores: Scores


def ask_everything(evidence: ScoreTable, covariates: Sequence[Covariate], factors: Sequence[Factor], shots: int,
                   seed: int, home: ReferenceSession | None = None) -> Asked:
    """All tests that the `shots` of the dataset can carry, except along a factor whose groups have random effects.

    home: the misfit of that session is subtracted.
    """
    rows = evidence.rows
    look = Look(len(rows), lambda what: what.codes[rows] if isinstance(what, Factor) else what.values[rows])
    grouped = next((column.name.partition(" ")[0] for column in evidence.columns if column.kind == "group"), "")
    shapes = [SAME, *(shape for one in covariates for shape in functions.number_shapes(one, look)),
              *(shape for one in factors if one.name != grouped for shape in functions.group_shapes(one, look))]
    tests: list[Test] = []
    parts: list[Scores] = []

    def ask(number: int, family: str, shapes: Sequence[WeightFunction]) -> None:
        weights = weights_of(shapes, look)
        tests.extend(Test(family, number, shape.what, shape.name, weights[:, k], shape)
                     for k, shape in enumerate(shapes))
        scores = efficient_scores(evidence, number, weights, rows, shots)
        parts.append(scores if home is None else home.beside(scores, evidence, number, shapes, weights))

    for number, column in enumerate(evidence.columns[:evidence.first_shared]):
        if column.kind == "term" or column.follows:
            ask(number, TERMS if column.kind == "term" else FREE, [SAME])
        else:
            ask(number, FREE, shapes)
    if pairs := functions.pair_shapes(covariates, look, seed):
        ask(evidence.index("launch speed"), PATTERN, pairs)
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
