"""The most probable residual, spread and half-heights, and how wide the residual may be a priori, by the evidence."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.optimize import minimize

from truearc.robot.config.schema import InputError
from truearc.sim.gate.likelihood import SIZE, GateData, Widths, curvature, value_and_slope

# Tried in this order, the first with the least of the second: what the emulated robot asked for lies in the middle.
SPEED_WIDTHS = (0.01, 0.015, 0.02, 0.03, 0.05, 0.08, 0.15)
HEIGHT_WIDTHS_M = (0.001, 0.01, 0.03, 0.1)
PAD = 64                              # rows are filled up to multiples of this: each size is compiled
MAX_STEPS = 300


class GateFit(NamedTuple):
    """theta [SIZE] at the maximum, covariance [SIZE, SIZE] around it, and the log evidence (Laplace), nats."""

    widths: Widths
    theta: np.ndarray
    covariance: np.ndarray
    evidence: float


def fit_widest(data: GateData, halves_m: tuple[float, float]) -> GateFit:
    """The fit whose widths have the most evidence: first the speed's is chosen, then the height's; deterministic."""
    data = padded(data)
    best = _best(data, halves_m, [Widths(HEIGHT_WIDTHS_M[0], speed) for speed in SPEED_WIDTHS], None)
    more = [Widths(height_m, best.widths.speed) for height_m in HEIGHT_WIDTHS_M[1:]]
    return _best(data, halves_m, more, best)


def fit_once(data: GateData, halves_m: tuple[float, float], widths: Widths, start: np.ndarray | None = None) -> GateFit:
    """MAP by Newton's method in a trust region, with exact first and second derivatives."""
    halves = jnp.asarray(halves_m)

    def slope(theta: np.ndarray) -> tuple[float, np.ndarray]:
        value, gradient = value_and_slope(theta, widths, data, halves)
        return float(value), np.asarray(gradient)

    def hessian(theta: np.ndarray) -> np.ndarray:
        return np.asarray(curvature(theta, widths, data, halves))

    done = minimize(slope, np.zeros(SIZE) if start is None else start, jac=True, hess=hessian, method="trust-exact",
                    options={"gtol": 1e-7, "maxiter": MAX_STEPS})
    eigenvalues, axes = np.linalg.eigh(hessian(done.x))
    if not np.isfinite(done.fun) or not np.isfinite(eigenvalues).all():
        raise InputError("the gate could not be fitted: the likelihood of these shots is not a number")
    eigenvalues = np.maximum(eigenvalues, 1e-3)   # the prior alone gives 1: less is only where the maximum is flat
    covariance = (axes / eigenvalues) @ axes.T
    return GateFit(widths, done.x, covariance, float(-done.fun - 0.5 * np.log(eigenvalues).sum()))


def padded(data: GateData) -> GateData:
    """Rows filled up to a multiple of PAD with copies of weight 0."""
    have = len(data.weight)
    rows = np.resize(np.arange(have), -(-have // PAD) * PAD)
    weight = np.where(np.arange(rows.size) < have, data.weight[rows], 0.0)
    return GateData(*(np.asarray(column)[rows] for column in data))._replace(weight=weight)


def _best(data: GateData, halves_m: tuple[float, float], tried: list[Widths], best: GateFit | None) -> GateFit:
    start = None if best is None else best.theta
    for widths in tried:
        fit = fit_once(data, halves_m, widths, start)
        start = fit.theta
        if best is None or fit.evidence > best.evidence:
            best = fit
    assert best is not None
    return best
