"""Evidence moved about: gain, slopes and the moved evidence tell one story."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from tests.sim.discover.made import with_plane
from truearc.sim.infer.likelihood.noise import HEIGHT_M, LAPSE, SLIP_M

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
