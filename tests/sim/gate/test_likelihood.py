"""The ordinal model against SciPy, and its derivatives against differences."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import approx_fprime
from scipy.stats import norm

from truearc.sim.gate.likelihood import (
    SIZE,
    GateData,
    GateShape,
    Widths,
    cell_probabilities,
    curvature,
    value_and_slope,
)

WIDTHS, HALVES = Widths(0.03, 0.02), jnp.array([0.35, 0.07])


def make_data(n: int = 40) -> GateData:
    rng = np.random.default_rng(4)
    cells = np.eye(5)[rng.integers(0, 5, n)]
    miss_m = np.where(np.arange(n) % 7 == 0, rng.normal(size=n), np.nan)
    return GateData(
        rng.normal(size=(n, 3)),
        0.3 * rng.normal(size=n),
        rng.uniform(0.05, 0.3, n),
        rng.uniform(2.0, 9.0, n),
        cells,
        miss_m,
        rng.integers(0, 2, n).astype(float),
    )


@settings(deadline=None)         # the first call compiles
@given(st.floats(-40.0, 40.0), st.floats(1e-3, 5.0), st.floats(0.01, 0.5), st.floats(0.01, 1.0), st.floats(1e-6, 0.5))
def test_cells_are_scipys_normal_and_three_lies_inside_two(mean: float, sigma: float, three: float, more: float,
                                                          lapse: float) -> None:
    shape = GateShape(1.0, 0.0, three + more, three, lapse)
    cells = np.asarray(cell_probabilities(shape, jnp.array([mean]), jnp.array([sigma])))[0]
    edges = norm.cdf([-three - more, -three, three, three + more], mean, sigma)
    wanted = np.diff(np.concatenate([[0.0], edges, [1.0]]))
    assert np.allclose(cells, (1.0 - lapse) * wanted + lapse * np.array([1, 1, 2, 1, 1]) / 6, atol=1e-12)
    assert abs(cells.sum() - 1.0) < 1e-12 and cells[2] <= cells[1:4].sum()


def test_slope_and_curvature_are_those_of_the_loss() -> None:
    data, theta = make_data(), 0.3 * np.random.default_rng(5).normal(size=SIZE)
    _, slope = value_and_slope(theta, WIDTHS, data, HALVES)
    near = approx_fprime(theta, lambda at: float(value_and_slope(at, WIDTHS, data, HALVES)[0]), 1e-7)
    assert np.allclose(slope, near, rtol=1e-4, atol=1e-4)
    hessian = np.asarray(curvature(theta, WIDTHS, data, HALVES))
    step = 1e-6 * np.eye(SIZE)[3]
    ahead, behind = (np.asarray(value_and_slope(theta + sign * step, WIDTHS, data, HALVES)[1]) for sign in (1, -1))
    assert np.allclose(hessian[3], (ahead - behind) / 2e-6, rtol=1e-4, atol=1e-3)
    assert np.allclose(hessian, hessian.T)


def test_a_row_of_weight_zero_has_no_say() -> None:
    data, theta = make_data(), np.zeros(SIZE)
    other = data._replace(deviation_m=np.where(data.weight > 0.0, data.deviation_m, 30.0))
    assert float(value_and_slope(theta, WIDTHS, data, HALVES)[0]) == float(
        value_and_slope(theta, WIDTHS, other, HALVES)[0])
    assert jax.tree.all(jax.tree.map(lambda leaf: bool(jnp.isfinite(leaf).all()),
                                     value_and_slope(theta, WIDTHS, other, HALVES)))
