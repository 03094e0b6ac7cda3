"""The gate's model against SciPy, its derivatives against differences, and novelty."""

import json
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import approx_fprime
from scipy.spatial import cKDTree
from scipy.stats import norm

from truearc.errors import InputError
from truearc.sim.gate import model

WIDTHS, HALVES = model.Widths(0.03, 0.02), jnp.array([0.35, 0.07])
ROWS = np.random.default_rng(1).uniform([2.0, 0.4, 30.0], [8.0, 0.8, 55.0], (90, 3))


def make_data(n: int = 40) -> model.GateData:
    rng = np.random.default_rng(4)
    cells = np.eye(5)[rng.integers(0, 5, n)]
    miss_m = np.where(np.arange(n) % 7 == 0, rng.normal(size=n), np.nan)
    return model.GateData(rng.normal(size=(n, 3)), 0.3 * rng.normal(size=n), rng.uniform(0.05, 0.3, n),
                          rng.uniform(2.0, 9.0, n), cells, miss_m, rng.integers(0, 2, n).astype(float))


@settings(deadline=None)         # the first call compiles
@given(st.floats(-40.0, 40.0), st.floats(1e-3, 5.0), st.floats(0.01, 0.5), st.floats(0.01, 1.0), st.floats(1e-6, 0.5))
def test_cells_are_scipys_normal_and_three_lies_inside_two(mean: float, sigma: float, three: float, more: float,
                                                          lapse: float) -> None:
    shape = model.GateShape(1.0, 0.0, three + more, three, lapse)
    cells = np.asarray(model.cell_probabilities(shape, jnp.array([mean]), jnp.array([sigma])))[0]
    edges = norm.cdf([-three - more, -three, three, three + more], mean, sigma)
    wanted = np.diff(np.concatenate([[0.0], edges, [1.0]]))
    assert np.allclose(cells, (1.0 - lapse) * wanted + lapse * np.array([1, 1, 2, 1, 1]) / 6, atol=1e-12)
    assert abs(cells.sum() - 1.0) < 1e-12 and cells[2] <= cells[1:4].sum()


def test_slope_and_curvature_are_those_of_the_loss() -> None:
    data, theta = make_data(), 0.3 * np.random.default_rng(5).normal(size=model.SIZE)
    _, slope = model.value_and_slope(theta, WIDTHS, data, HALVES)
    near = approx_fprime(theta, lambda at: float(model.value_and_slope(at, WIDTHS, data, HALVES)[0]), 1e-7)
    assert np.allclose(slope, near, rtol=1e-4, atol=1e-4)
    hessian = np.asarray(model.curvature(theta, WIDTHS, data, HALVES))
    step = 1e-6 * np.eye(model.SIZE)[3]
    ahead, behind = (np.asarray(model.value_and_slope(theta + sign * step, WIDTHS, data, HALVES)[1])
                     for sign in (1, -1))
    assert np.allclose(hessian[3], (ahead - behind) / 2e-6, rtol=1e-4, atol=1e-3)
    assert np.allclose(hessian, hessian.T)


def test_a_row_of_weight_zero_has_no_say() -> None:
    data, theta = make_data(), np.zeros(model.SIZE)
    other = data._replace(deviation_m=np.where(data.weight > 0.0, data.deviation_m, 30.0))
    assert float(model.value_and_slope(theta, WIDTHS, data, HALVES)[0]) == float(
        model.value_and_slope(theta, WIDTHS, other, HALVES)[0])
    assert jax.tree.all(jax.tree.map(lambda leaf: bool(jnp.isfinite(leaf).all()),
                                     model.value_and_slope(theta, WIDTHS, other, HALVES)))


def test_it_is_the_distance_to_the_third_nearest_in_standard_deviations() -> None:
    novelty = model.fit_novelty(ROWS)
    asked = np.random.default_rng(2).uniform([0.0, 0.0, 0.0], [20.0, 1.0, 90.0], (5000, 3))
    tree = cKDTree(ROWS / ROWS.std(axis=0))
    wanted = tree.query(asked / ROWS.std(axis=0), k=[3])[0][:, 0] / novelty.largest
    assert np.allclose(novelty(asked), wanted, rtol=1e-4, atol=1e-4)
    assert len(novelty.landmarks) == 90


def test_what_was_recorded_is_known_but_for_one_in_a_hundred_and_what_is_far_is_not() -> None:
    novelty = model.fit_novelty(ROWS)
    assert (novelty(ROWS) > 1.0).sum() <= 1
    assert (novelty(ROWS + 3.0 * ROWS.std(axis=0) * [1.0, -1.0, 1.0]) > 1.0).mean() > 0.9


def test_repeats_of_a_configuration_do_not_shrink_the_domain() -> None:
    noise = 0.005 * ROWS.std(axis=0) * np.random.default_rng(3).normal(size=(10, 90, 3))
    repeated = model.fit_novelty((ROWS + noise).reshape(-1, 3))
    assert len(repeated.landmarks) == 90
    assert repeated.largest == pytest.approx(model.fit_novelty(ROWS).largest, rel=0.05)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_few_rows_are_enough_to_say_something_finite(count: int) -> None:
    novelty = model.fit_novelty(np.array([[4.0, 0.5, 40.0]] * 2 + ROWS[:count - 1].tolist()))
    assert np.isfinite(novelty(ROWS)).all() and novelty(np.array([[4.0, 0.5, 40.0]]))[0] <= 1.0


@settings(deadline=None)
@given(st.integers(0, 1000), st.integers(1, 60), st.integers(1, 40))
def test_landmarks_cover_the_rows_or_are_as_many_as_allowed(seed: int, count: int, most: int) -> None:
    points = np.random.default_rng(seed).normal(size=(count, 3))
    chosen = model.farthest_points(points, model.SAME_DISTANCE, most)
    assert len(set(chosen.tolist())) == len(chosen) <= most
    apart = np.linalg.norm(points[:, None] - points[chosen], axis=2).min(axis=1)
    assert len(chosen) == most or apart.max() <= model.SAME_DISTANCE


def test_a_record_reads_back_exactly() -> None:
    novelty = model.fit_novelty(ROWS)
    again = model.parse_novelty(json.loads(json.dumps(model.novelty_record(novelty))), "x")
    assert np.array_equal(again(ROWS), novelty(ROWS)) and again.largest == novelty.largest


@pytest.mark.parametrize("spoilt", [{"mean": [1.0, 2.0]}, {"landmarks": []}, {"largest": 0.0}, {"neighbour": 99},
                                    {"scale": "wide"}, {"landmarks": [[1.0, float("nan"), 2.0]] * 4}])
def test_a_damaged_record_is_refused_by_name(spoilt: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=r"training\.json: key 'novelty'"):
        model.parse_novelty(model.novelty_record(model.fit_novelty(ROWS)) | spoilt, "training.json")
    with pytest.raises(InputError, match="train again"):
        model.parse_novelty(None, "training.json")
