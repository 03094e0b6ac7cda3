"""Columns of groups kept once a shot are the same as indicator columns, whoever asks."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.sim.discover.made import column, heights
from truearc.sim.discover.detect.battery import efficient_scores
from truearc.sim.infer.likelihood.score_table import GroupedColumns, PlaneScores, ScoreTable, make_evidence

SHOTS, REAL, EFFECTS, GROUPS = 14, 4, 2, 3
WIDE = REAL + EFFECTS * GROUPS

seeds = st.integers(0, 10_000)


def indicators(label: np.ndarray) -> np.ndarray:
    """[n, C, P]: which of all columns each of a shot's own is."""
    found = np.zeros((SHOTS, REAL + EFFECTS, WIDE))
    for shot, group in enumerate(label):
        for k in range(REAL):
            found[shot, k, k] = 1.0
        for effect in range(EFFECTS):
            found[shot, REAL + effect, REAL + effect * GROUPS + group] = 1.0
    return found


def both_ways(seed: int) -> tuple[ScoreTable, ScoreTable]:
    """(evidence with groups, the same with indicator columns); two free columns, two fitted, two effects a group."""
    rng = np.random.default_rng(seed)
    label = np.concatenate([np.arange(GROUPS), rng.integers(0, GROUPS, SHOTS - GROUPS)])
    own = REAL + EFFECTS
    root, rows = rng.normal(size=(SHOTS, own, own)), np.arange(0, SHOTS, 2)
    bend, linear = root @ np.swapaxes(root, 1, 2), rng.normal(size=(SHOTS, own))
    seen, mean, spread = heights(len(rows), rng), rng.normal(0.0, 0.3, len(rows)), rng.uniform(0.05, 0.3, len(rows))
    parts = [rng.normal(0.0, size, (len(rows), own)) for size in (0.3, 0.01, 0.1)]
    columns = (*(column(f"c{k}") for k in range(2)), column("a", "shared"), column("b", "shared"),
               *(column(f"ball {k}", "group") for k in range(EFFECTS * GROUPS)))
    precision, pull = np.diag(rng.uniform(0.5, 2.0, WIDE - 2)), rng.normal(size=WIDE - 2)
    rest, told = (precision, pull, rng.normal(size=SHOTS)), indicators(label)
    few = make_evidence(
        np.arange(SHOTS),
        columns,
        np.zeros(WIDE),
        linear,
        bend,
        PlaneScores(rows, seen, mean, spread, *parts),
        *rest,
        GroupedColumns(REAL, EFFECTS, GROUPS, label),
    )
    dealt = [np.einsum("nc,ncp->np", part, told[rows]) for part in parts]
    many = make_evidence(np.arange(SHOTS), columns, np.zeros(WIDE), np.einsum("nc,ncp->np", linear, told),
                         np.einsum("ncp,ncd,ndq->npq", told, bend, told), PlaneScores(rows, seen, mean, spread, *dealt),
                         *rest)
    return few, many


def same(few: ScoreTable, many: ScoreTable) -> None:
    assert few.score == pytest.approx(many.score)
    assert few.information == pytest.approx(many.info.sum(0))
    assert few.told_by([0, 3, 3]) == pytest.approx(many.info[[0, 3, 3]].sum(0))
    assert few.log_score == pytest.approx(many.log_score)


@settings(max_examples=20, deadline=None)
@given(seed=seeds)
def test_evidence_with_groups_is_that_with_indicator_columns(seed: int) -> None:
    few, many = both_ways(seed)
    change = np.random.default_rng(seed + 1).normal(0.0, 0.3, (SHOTS, WIDE))
    same(few, many)
    assert few.gain(change) == pytest.approx(many.gain(change))
    same(few.moved(change), many.moved(change))
    for kept in (np.arange(2, WIDE), np.array([1, *range(2, WIDE)]), np.array([1, 0, 2, 3])):
        a, b = few.pick(kept), many.pick(kept)
        assert [one.name for one in a.columns] == [one.name for one in b.columns]
        assert a.score == pytest.approx(b.score) and a.information == pytest.approx(b.information)


@settings(max_examples=20, deadline=None)
@given(seed=seeds)
def test_efficient_scores_are_those_by_indicator_columns(seed: int) -> None:
    few, many = both_ways(seed)
    weights = np.random.default_rng(seed + 2).normal(size=(SHOTS, 3))
    a, b = (efficient_scores(one, 1, weights, np.arange(SHOTS), SHOTS) for one in (few, many))
    assert a.psi == pytest.approx(b.psi) and a.kappa == pytest.approx(b.kappa)
    assert a.stretch == pytest.approx(b.stretch) and (a.kept == b.kept).all()


def test_shots_without_groups_have_all_columns() -> None:
    deal = GroupedColumns.plain(3, 4)
    assert deal.width == 4 and (deal.place == np.arange(4)).all()
