"""Kennedy and O'Hagan's calibration: an emulator of a simulator's runs, its parameters, and a discrepancy, sampled.

Measured y(x) = eta(x, theta) + delta(x) + noise (Kennedy & O'Hagan 2001; Higdon et al. 2004). eta and delta are
Gaussian processes with squared-exponential correlations, inputs scaled to 0..1 and outputs standardised by the runs.
Priors are those of SEPIA's ball drop (lanl/SEPIA): theta uniform over the runs; precisions of discrepancy and noise
Gamma(1, 0.001); the correlation of the discrepancy at half an input's range Beta(1, 0.1).

What differs from SEPIA: y is a number, whatever it is a function of is one more input, so there are no bases (its
kernels of 1.5 m carry no information across drops 5 m apart); the emulator's numbers are at their most probable, as in
Kennedy and O'Hagan's own paper, and sampled there. It has no terms to name: delta is a curve. SEPIA is on no package
index. Of packages there, BAND's has no discrepancy, kohgpjax needs another JAX, and ACBICI a documentation builder at
run time.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel
from threadpoolctl import threadpool_limits

from truearc_proof.rivals.claim import Array

PRECISION_RATE, SMOOTH_RATE = 1e-3, 0.1        # of the Gamma(1, rate) and Beta(1, rate) priors
NUGGET = 1e-6                         # of the emulator, as a share of the runs' variance
STEPS, BURN, ADAPT, THIN = 12_000, 4_000, 200, 20
DRAWS = 5                             # a kept sample
LARGEST = 30.0                        # -log(1 - correlation)


class Runs(NamedTuple):
    """A simulator's: inputs x [m, p], parameters theta [m, q], outputs y [m]."""

    x: Array
    theta: Array
    y: Array


class Forecast(NamedTuple):
    """Means and ends of 90 % intervals, all [k]."""

    mean: Array
    low90: Array
    high90: Array


class Emulator:
    """The runs' Gaussian process in scaled units: inputs by `low` and `range` [p + q], outputs by `middle`, `unit`."""

    def __init__(self, runs: Runs) -> None:
        inputs = np.column_stack([runs.x, runs.theta])
        self.low, self.range = inputs.min(0), np.ptp(inputs, axis=0)
        self.middle, self.unit, self.inputs = runs.y.mean(), runs.y.std(), runs.x.shape[1]
        kernel = ConstantKernel(10.0, (1e-1, 1e5)) * RBF(np.full(len(self.low), 1.0), (0.05, 50.0))
        with threadpool_limits(1):
            self._process = GaussianProcessRegressor(kernel, alpha=NUGGET).fit(
                (inputs - self.low) / self.range, (runs.y - self.middle) / self.unit)

    def scaled(self, x: Array) -> Array:
        """[n, p] in 0..1 of the runs."""
        scaled: Array = (x - self.low[:self.inputs]) / self.range[:self.inputs]
        return scaled

    def at(self, scaled: Array, theta: Array) -> tuple[Array, Array]:
        """(means [n], covariance [n, n]) at scaled inputs [n, p] and parameters [q]."""
        both = np.column_stack([scaled, np.broadcast_to(theta, (len(scaled), len(theta)))])
        mean, covariance = self._process.predict(both, return_cov=True)
        return mean, covariance


class Calibration:
    """Samples of the posterior given field data x [n, p], y [n]; without `discrepancy` the simulator is right."""

    def __init__(self, emulator: Emulator, x: Array, y: Array, discrepancy: bool = True, seed: int = 0,
                 steps: int = STEPS) -> None:
        self._emulator, self._x = emulator, emulator.scaled(x)
        self._y = (y - emulator.middle) / emulator.unit
        self._free, self._count = discrepancy, len(emulator.low) - emulator.inputs
        self._rng = np.random.default_rng(seed)
        smooth = [np.log(20.0), *[3.0] * emulator.inputs] if discrepancy else []
        start = np.array([*[0.5] * self._count, -np.log(PRECISION_RATE), *smooth])
        with threadpool_limits(1):
            self._samples = sample(self._log_posterior, start, self._rng, steps)

    @property
    def theta90(self) -> Array:
        """[q, 3] ends and middle of each parameter's 90 % interval, low, median, high, in the runs' units."""
        quantiles = np.quantile(self._samples[:, :self._count], (0.05, 0.5, 0.95), axis=0).T
        own: Array = self._emulator.low[-self._count:, None] + self._emulator.range[-self._count:, None] * quantiles
        return own

    def forecast(self, x: Array) -> Forecast:
        """A measurement at each of inputs [k, p]."""
        return self._draw(x, False)

    def discrepancy(self, x: Array) -> Forecast:
        """The simulator's error at each of inputs [k, p]."""
        return self._draw(x, True)

    def _draw(self, x: Array, discrepancy: bool) -> Forecast:
        n, both = len(self._x), np.concatenate([self._x, self._emulator.scaled(x)])
        draws, means = [], []
        with threadpool_limits(1):
            for at in self._samples:
                theta, noise, smooth = self._parts(at)
                mean, covariance = self._emulator.at(both, theta)
                apart = _process(both, smooth)
                seen = covariance[:n, :n] + apart[:n, :n] + noise * np.eye(n)
                mean, whole = (0.0 * mean, apart) if discrepancy else (mean, covariance + apart)
                off = self._y - (self._emulator.at(self._x, theta)[0] if discrepancy else mean[:n])
                gain = np.linalg.solve(seen, whole[:n, n:]).T
                spread = np.diag(whole[n:, n:] - gain @ whole[:n, n:]) + (0.0 if discrepancy else noise)
                means.append(mean[n:] + gain @ off)
                draws.append(means[-1] + np.sqrt(np.maximum(spread, 0.0)) * self._rng.normal(size=(DRAWS, len(x))))
        middle = 0.0 if discrepancy else self._emulator.middle
        low, high = np.quantile(np.concatenate(draws), (0.05, 0.95), axis=0)
        return Forecast(*(middle + self._emulator.unit * part for part in (np.mean(means, axis=0), low, high)))

    def _parts(self, at: Array) -> tuple[Array, float, Array]:
        """(theta [q], noise's variance, log precision and -log(1 - correlations) of the discrepancy; none: empty)."""
        return at[:self._count], float(np.exp(-at[self._count])), at[self._count + 1:]

    def _log_posterior(self, at: Array) -> float:
        theta, noise, smooth = self._parts(at)
        if (theta < 0.0).any() or (theta > 1.0).any() or (smooth[1:] < 0.0).any() or (smooth[1:] > LARGEST).any():
            return -np.inf
        logs = at[[self._count, self._count + 1] if self._free else [self._count]]
        prior = (logs - PRECISION_RATE * np.exp(logs)).sum() - SMOOTH_RATE * smooth[1:].sum()
        mean, covariance = self._emulator.at(self._x, theta)
        covariance = covariance + _process(self._x, smooth) + (noise + 1e-9) * np.eye(len(mean))
        off = self._y - mean
        return float(prior - 0.5 * np.linalg.slogdet(covariance)[1] - 0.5 * off @ np.linalg.solve(covariance, off))


def _process(scaled: Array, smooth: Array) -> Array:
    """[n, n] covariance of the discrepancy."""
    if not len(smooth):
        return np.zeros((len(scaled), len(scaled)))
    apart = (scaled[:, None] - scaled)**2
    log_correlation = np.log1p(-np.exp(-np.maximum(smooth[1:], 1e-9)))
    process: Array = np.exp(4.0 * apart @ log_correlation - smooth[0])
    return process


def sample(log_density: Callable[[Array], float], start: Array, rng: np.random.Generator, steps: int = STEPS) -> Array:
    """[steps after BURN / THIN, d] by Metropolis; until BURN the step follows the chain's covariance (Haario 2001)."""
    now, value, step = start, log_density(start), 0.1 * np.eye(len(start))
    burn = BURN * steps // STEPS
    chain: list[Array] = []
    for turn in range(steps):
        if turn and turn % ADAPT == 0 and turn <= burn:
            spread = np.cov(np.array(chain[turn // 2:]).T).reshape(len(start), -1) + 1e-6 * np.eye(len(start))
            step = 2.4 / np.sqrt(len(start)) * np.linalg.cholesky(spread)
        new = now + step @ rng.normal(size=len(start))
        wanted = log_density(new)
        if np.log(rng.uniform()) < wanted - value:
            now, value = new, wanted
        chain.append(now)
    return np.array(chain[burn::THIN])
