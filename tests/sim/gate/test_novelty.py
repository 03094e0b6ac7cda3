"""Novelty against SciPy's tree; repeats count once; a record reads back exactly or is refused."""

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from truearc.errors import InputError
from truearc.sim.gate.model import SAME_DISTANCE, farthest_points, fit_novelty, novelty_record, parse_novelty

ROWS = np.random.default_rng(1).uniform([2.0, 0.4, 30.0], [8.0, 0.8, 55.0], (90, 3))


def test_it_is_the_distance_to_the_third_nearest_in_standard_deviations() -> None:
    novelty = fit_novelty(ROWS)
    asked = np.random.default_rng(2).uniform([0.0, 0.0, 0.0], [20.0, 1.0, 90.0], (5000, 3))
    tree = cKDTree(ROWS / ROWS.std(axis=0))
    wanted = tree.query(asked / ROWS.std(axis=0), k=[3])[0][:, 0] / novelty.largest
    assert np.allclose(novelty(asked), wanted, rtol=1e-4, atol=1e-4)
    assert len(novelty.landmarks) == 90


def test_what_was_recorded_is_known_but_for_one_in_a_hundred_and_what_is_far_is_not() -> None:
    novelty = fit_novelty(ROWS)
    assert (novelty(ROWS) > 1.0).sum() <= 1
    assert (novelty(ROWS + 3.0 * ROWS.std(axis=0) * [1.0, -1.0, 1.0]) > 1.0).mean() > 0.9


def test_repeats_of_a_configuration_do_not_shrink_the_domain() -> None:
    noise = 0.005 * ROWS.std(axis=0) * np.random.default_rng(3).normal(size=(10, 90, 3))
    repeated = fit_novelty((ROWS + noise).reshape(-1, 3))
    assert len(repeated.landmarks) == 90
    assert repeated.largest == pytest.approx(fit_novelty(ROWS).largest, rel=0.05)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_few_rows_are_enough_to_say_something_finite(count: int) -> None:
    novelty = fit_novelty(np.array([[4.0, 0.5, 40.0]] * 2 + ROWS[:count - 1].tolist()))
    assert np.isfinite(novelty(ROWS)).all() and novelty(np.array([[4.0, 0.5, 40.0]]))[0] <= 1.0


@settings(deadline=None)
@given(st.integers(0, 1000), st.integers(1, 60), st.integers(1, 40))
def test_landmarks_cover_the_rows_or_are_as_many_as_allowed(seed: int, count: int, most: int) -> None:
    points = np.random.default_rng(seed).normal(size=(count, 3))
    chosen = farthest_points(points, SAME_DISTANCE, most)
    assert len(set(chosen.tolist())) == len(chosen) <= most
    apart = np.linalg.norm(points[:, None] - points[chosen], axis=2).min(axis=1)
    assert len(chosen) == most or apart.max() <= SAME_DISTANCE


def test_a_record_reads_back_exactly() -> None:
    novelty = fit_novelty(ROWS)
    again = parse_novelty(json.loads(json.dumps(novelty_record(novelty))), "x")
    assert np.array_equal(again(ROWS), novelty(ROWS)) and again.largest == novelty.largest


@pytest.mark.parametrize("spoilt", [{"mean": [1.0, 2.0]}, {"landmarks": []}, {"largest": 0.0}, {"neighbour": 99},
                                    {"scale": "wide"}, {"landmarks": [[1.0, float("nan"), 2.0]] * 4}])
def test_a_damaged_record_is_refused_by_name(spoilt: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=r"training\.json: key 'novelty'"):
        parse_novelty(novelty_record(fit_novelty(ROWS)) | spoilt, "training.json")
    with pytest.raises(InputError, match="train again"):
        parse_novelty(None, "training.json")
