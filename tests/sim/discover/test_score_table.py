"""Score tables: gain, slopes and moved evidence tell one story; groups kept once a shot are indicator columns."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from tests.sim.discover.made import column, heights, with_plane
from truearc.sim.discover.detect.battery import efficient_scores
from truearc.sim.infer.likelihood.noise import HEIGHT_M, LAPSE, SLIP_M
from truearc.sim.infer.likelihood.score_table import GroupedColumns, PlaneScores, ScoreTable, make_evidence

seeds = st.integers(0, 10_000)


def some_change(seed: int, shape: tuple[int, int]) -> np.ndarray:
    return np.random.default_rng(seed + 1).normal(0.0, 0.3, shape)


@settings(max_examples=30, deadline=None)
@given(seed=seeds)
def test_slopes_are_the_gains_differences(seed: int) -> None:
    evidence = with_plane(seed)
    change = some_change(seed, evidence.score.shape)
    score, _ = evidence.slopes_at(change)
    for k in range(change.shape[1]):
        step = np.zeros_like(change)
        step[:, k] = 1e-5
        slope = (evidence.gain(change + step) - evidence.gain(change - step)) / 2e-5
        assert score[:, k] == pytest.approx(slope, rel=1e-4, abs=1e-3)


@settings(max_examples=30, deadline=None)
@given(seed=seeds)
def test_moved_evidence_gains_what_is_left_to_gain(seed: int) -> None:
    evidence = with_plane(seed)
    first, second = some_change(seed, evidence.score.shape), some_change(seed + 7, evidence.score.shape)
    there = evidence.moved(first)
    assert there.log_score == pytest.approx(evidence.log_score + evidence.gain(first))
    assert there.score == pytest.approx(evidence.slopes_at(first)[0])
    assert there.info == pytest.approx(evidence.slopes_at(first)[1])
    assert there.gain(second) == pytest.approx(evidence.gain(first + second) - evidence.gain(first), abs=1e-6)
    assert there.slopes_at(second)[0] == pytest.approx(evidence.slopes_at(first + second)[0], rel=1e-6, abs=1e-6)
    back = there.moved(-first)
    assert back.log_score == pytest.approx(evidence.log_score, abs=1e-6)
    assert back.linear == pytest.approx(evidence.linear, abs=1e-9)


@settings(max_examples=20, deadline=None)
@given(seed=seeds)
def test_expected_information_is_what_scores_scatter_by(seed: int) -> None:
    """Heights drawn from the model itself: the mean of squared scores over what can happen is the information."""
    evidence = with_plane(seed)
    plane = evidence.plane
    assert plane is not None
    assert (np.linalg.eigvalsh(evidence.info) > -1e-9).all()
    more = evidence.info[plane.rows] - evidence.bend[plane.rows]
    assert (np.linalg.eigvalsh(more) > -1e-9).all()
    # only heights that were measured tell more than any class could
    measured = plane.seen.measured
    wide = plane.spread_m**2 + HEIGHT_M**2
    exact = np.einsum("mi,mj,m->mij", plane.by_column, plane.by_column, 1.0 / wide) + 2.0 * np.einsum(
        "mi,mj,m->mij", plane.log_spread_by, plane.log_spread_by, (plane.spread_m**2 / wide)**2)
    slip = LAPSE / SLIP_M / ((1.0 - LAPSE) * norm.pdf(plane.seen.height_m, plane.mean_m, np.sqrt(wide)))
    assert more[measured] == pytest.approx((exact / (1.0 + slip)[:, None, None])[measured])


@settings(max_examples=20, deadline=None)
@given(seed=seeds)
def test_columns_picked_are_the_same_columns(seed: int) -> None:
    evidence = with_plane(seed)
    kept = np.array([1, 2, 3])
    picked = evidence.pick(kept)
    assert [one.name for one in picked.columns] == ["c1", "a", "b"]
    assert picked.first_shared == 1 and picked.index("a") == 1
    assert picked.shared == slice(1, None)
    change = some_change(seed, picked.score.shape)
    whole = np.zeros_like(evidence.score)
    whole[:, kept] = change
    assert picked.gain(change) == pytest.approx(evidence.gain(whole))
    assert picked.slopes_at(change)[0] == pytest.approx(evidence.slopes_at(whole)[0][:, kept])


SHOTS, REAL, EFFECTS, GROUPS = 14, 4, 2, 3
WIDE = REAL + EFFECTS * GROUPS


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
    few = make_evidence(np.arange(SHOTS), columns, np.zeros(WIDE), linear, bend,
                        PlaneScores(rows, seen, mean, spread, *parts), *rest,
                        GroupedColumns(REAL, EFFECTS, GROUPS, label))
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
