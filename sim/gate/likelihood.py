"""The gate's model: height at the plane = physics + a small learned residual + noise, seen as outcomes (JAX).

    y = h(x) - centre + r(x) + sigma(x) e,   e standard normal
    r(x) = height_width b . q(z) + speed_width (dh / dlog v)(x) c . q(z),   q = 1, z, z z' (10 functions)
    sigma(x)^2 = scale^2 propagated(x)^2 + floor^2
    three where |y| < three half-height, two where |y| < two half-height; a lapse gives any outcome

The second half of r is an exit speed that is not quite what the launch terms say, the first all else. All numbers that
are fitted are standard normal a priori: b and c as they stand, the others by what PRIORS says of their logarithm. How
wide the residual may be a priori is chosen by the evidence.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.stats import norm
from scipy.optimize import minimize

import truearc.sim.physics  # noqa: F401 - the house's one switch to double precision
from truearc.errors import InputError
from truearc.sim.infer.likelihood.noise import GATE_LAPSE, GATE_LAPSE_CELLS, GATE_SLIP_M, HEIGHT_M

FUNCTIONS = 10
RESIDUAL = 2 * FUNCTIONS
# (median, standard deviation of the log). The scale is of the propagated spread, which configurations labelled by
# repeatability have next to nothing of; half-heights are those of rig.toml, which such labels make effectively smaller.
PRIORS = {"scale": (1.0, 0.7), "floor_m": (0.02, 1.0), "two": (1.0, 0.1), "three": (1.0, 0.3), "lapse": GATE_LAPSE}
SIZE = RESIDUAL + len(PRIORS)
LAPSE_CELLS = np.array(GATE_LAPSE_CELLS)
# Tried in this order, the first with the least of the second: what the emulated robot asked for lies in the middle.
SPEED_WIDTHS = (0.01, 0.015, 0.02, 0.03, 0.05, 0.08, 0.15)
HEIGHT_WIDTHS_M = (0.001, 0.01, 0.03, 0.1)
PAD = 64                              # rows are filled up to multiples of this: each size is compiled
MAX_STEPS = 300


class GateData(NamedTuple):
    """Rows [n] that the model is fitted to, or predicts; `weight` 0 leaves a row out."""

    z: Any                            # [n, 3] standardised features
    deviation_m: Any
    sigma_m: Any
    by_speed_m: Any
    cells: Any                        # [n, 5]
    miss_m: Any
    weight: Any


class Widths(NamedTuple):
    """A priori standard deviations of the residual's coefficients: m, and share of the exit speed."""

    height_m: Any
    speed: Any


class GateShape(NamedTuple):
    """What theta says besides the residual."""

    scale: Any
    floor_m: Any
    two_m: Any
    three_m: Any
    lapse: Any


def basis(z: Any) -> Any:
    """Constant, linear and quadratic functions [n, 10] of standardised features [n, 3], each of about unit size."""
    x, y, w = z[:, 0], z[:, 1], z[:, 2]
    return jnp.stack([jnp.ones_like(x), x, y, w, 0.7 * (x * x - 1.0), 0.7 * (y * y - 1.0), 0.7 * (w * w - 1.0),
                      x * y, x * w, y * w], axis=1)


def residual_basis(widths: Widths, z: Any, by_speed_m: Any) -> Any:
    """[n, 20] in m: the residual is this times the first RESIDUAL numbers of theta."""
    functions = basis(z)
    return jnp.concatenate([widths.height_m * functions, widths.speed * by_speed_m[:, None] * functions], axis=1)


def shape_of(theta: Any, halves_m: Any) -> GateShape:
    """Scale, floor, half-heights and lapse of theta; halves_m: (two, three) of rig.toml."""
    scale, floor_m, two, three, lapse = (median * jnp.exp(spread * theta[RESIDUAL + k])
                                         for k, (median, spread) in enumerate(PRIORS.values()))
    two_m = two * halves_m[0]
    return GateShape(scale, floor_m, two_m, jnp.minimum(three * halves_m[1], two_m), jnp.minimum(lapse, 0.5))


def spread_m(shape: GateShape, propagated_m: Any, doubt_m: Any = 0.0) -> Any:
    """Standard deviation of the height; `doubt_m`: of the residual itself."""
    return jnp.sqrt((shape.scale * propagated_m) ** 2 + shape.floor_m**2 + doubt_m**2)


def cell_probabilities(shape: GateShape, mean_m: Any, sigma_m: Any) -> Any:
    """[n, 5]: miss low, two low, three, two high, miss high; rows sum to 1."""
    below = [norm.cdf((edge - mean_m) / sigma_m) for edge in (-shape.two_m, -shape.three_m, shape.three_m)]
    above = norm.cdf((mean_m - shape.two_m) / sigma_m)
    cells = jnp.stack([below[0], below[1] - below[0], below[2] - below[1],
                       norm.cdf((mean_m - shape.three_m) / sigma_m) - above, above], axis=1)
    return (1.0 - shape.lapse) * cells + shape.lapse * LAPSE_CELLS


def log_likelihoods(theta: Any, widths: Widths, data: GateData, halves_m: Any) -> Any:
    """Log probability [n] of what each row says (a log density in 1/m where the height was measured)."""
    shape = shape_of(theta, halves_m)
    mean_m = data.deviation_m + residual_basis(widths, data.z, data.by_speed_m) @ theta[:RESIDUAL]
    sigma_m = spread_m(shape, data.sigma_m)
    seen = jnp.sum(cell_probabilities(shape, mean_m, sigma_m) * data.cells, axis=1)
    measured = ~jnp.isnan(data.miss_m)
    apart = jnp.where(measured, data.miss_m, 0.0) - mean_m
    density = norm.pdf(apart, scale=jnp.sqrt(sigma_m**2 + HEIGHT_M**2))
    anywhere = shape.lapse / (2.0 * GATE_SLIP_M)
    return jnp.log(jnp.where(measured, (1.0 - shape.lapse) * density + anywhere, jnp.maximum(seen, 1e-300)))


def loss(theta: Any, widths: Widths, data: GateData, halves_m: Any) -> Any:
    """Minus the log posterior, up to a constant."""
    return 0.5 * theta @ theta - jnp.dot(data.weight, log_likelihoods(theta, widths, data, halves_m))


value_and_slope = jax.jit(jax.value_and_grad(loss))
curvature = jax.jit(jax.jacfwd(jax.grad(loss)))               # Hessian [SIZE, SIZE] of the loss


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
