"""Rivals that model the simulator's residual: learners, and Kennedy and O'Hagan's calibration with a discrepancy.

A shot's residual is the difference, in three coordinates, between its track's last sample and the forecast from the
first 40 % of its samples by the believed physics, fitted to the other folds. The covariates are all columns that
truearc tests (configuration, launch state, circumstances, telemetry). A learner has no terms of its own. If its most
important covariate is one that terms of the catalogue follow from shot to shot (air density, age of the ball, battery,
...), it names those terms, flight terms first, since the first samples determine the launch. A dozen terms depend on
distance, elevation, speed or spin; for these covariates it names nothing.

The calibration samples the parameters of a simulator, an emulator of its runs, and a discrepancy. The measured value is
y(x) = eta(x, theta) + delta(x) + noise (Kennedy & O'Hagan 2001; Higdon et al. 2004). eta and delta are Gaussian
processes with squared-exponential correlations; inputs are scaled to 0..1, and outputs are standardised by the runs.
The priors are those of SEPIA's ball drop (lanl/SEPIA): theta is uniform over the runs, the precisions of discrepancy
and noise are Gamma(1, 0.001), and the correlation of the discrepancy at half an input's range is Beta(1, 0.1).

The calibration differs from SEPIA in two ways. Here y is a number and its arguments are further inputs, so there are no
bases (SEPIA's kernels of 1.5 m carry no information across drops 5 m apart). The emulator's numbers are fixed at their
most probable values, as in Kennedy and O'Hagan's paper, whereas SEPIA samples them. The calibration cannot name terms,
since delta is a curve. SEPIA is not on any package index. Of the packages that are, BAND's has no discrepancy, kohgpjax
needs another version of JAX, and ACBICI needs a documentation builder at run time.
"""

import warnings
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.optimize import Bounds, minimize
from sklearn.ensemble import HistGradientBoostingRegressor
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
from threadpoolctl import threadpool_limits

from truearc.sim.data.dataset import Dataset
from truearc.sim.discover.detect.covariates import FOLLOWED, Covariate, gather_covariates
from truearc.sim.discover.select.simulations import track_errors
from truearc.sim.physics.catalogue import TERMS
from truearc_proof.rivals.claim import Array, Claim, RivalBelief, folds, rms

# --- learners of the residual

SCALES = (0.1, 1e3)                   # of length, in standard deviations of a covariate
SHARES = (1e-4, 1e2)                  # of variance, in the residuals' own
START = (3.0, 0.3, 0.7)               # length scale, share of the process, share of the noise
CLIMB = 25                            # of the climb: a longer one, where tried, made more of noise, at thrice the cost
TREES, RATE, LEAVES, LEAST_SHOTS = 300, 0.05, 8, 15
INNER, PATIENCE = 0.2, 15             # share of shots that say when to stop, and trees without gain until then


class Learnt(NamedTuple):
    """A regression of residuals [n, 3] on covariates [n, q]: what it says at others, and how much it leans on each
    covariate [q], most = largest."""

    predict: Callable[[Array], Array]
    leaning: Callable[[], Array]


Learn = Callable[[Array, Array], Learnt]      # of covariates and residuals


def claim_by(dataset: Dataset, believed: RivalBelief, learn: Learn) -> Claim:
    """Return the learner's claim; it says something if it forecasts held-out residuals better than 0 does."""
    covariates = gather_covariates(dataset)
    residuals = residuals_of(believed)
    table = table_of(covariates, believed.fitted.model.data.rows[believed.fitted.model.data.tracked])
    foretold = cross_validate(table, residuals, learn)
    each = gain_of_each(residuals, foretold)
    says = bool(each.mean() > 0.0)
    names = names_of(covariates, learn(table, residuals).leaning()) if says else ()
    left = residuals - foretold if says else residuals
    return Claim(says, names, rms(residuals[:, -1]), rms(left[:, -1]),
                 {"gain": float(each.mean()), "gain_se": float(each.std() / np.sqrt(len(each)))})


def residuals_of(believed: RivalBelief) -> Array:
    """Return [k, c] in m of the tracked shots' measured coordinates, height last, each from a believed fit without that
    shot."""
    null = believed.fitted.without_terms()
    errors = track_errors(null, null.scores.held_out_change())
    return errors[:, (errors != 0.0).any(axis=0)]


def table_of(covariates: Sequence[Covariate], rows: Array) -> Array:
    """Return [k, q] standardised covariates, unknown = 0 (the mean)."""
    values = np.stack([covariate.values[rows] for covariate in covariates], axis=1)
    spread = np.nanstd(values, axis=0)
    table: Array = np.nan_to_num((values - np.nanmean(values, axis=0)) / np.where(spread > 0.0, spread, 1.0))
    return table


def cross_validate(table: Array, residuals: Array, learn: Learn) -> Array:
    """Return [k, 3]: each fold's residuals as forecast from the other folds."""
    foretold = np.zeros_like(residuals)
    for held in folds(len(table)):
        foretold[held.out] = learn(table[held.train], residuals[held.train]).predict(table[held.out])
    return foretold


def gain_of_each(residuals: Array, foretold: Array) -> Array:
    """Return [k]: the reduction of each shot's squared error by the forecast, as a share of the mean, coordinates
    weighted equally."""
    scale = np.mean(residuals**2, axis=0)
    gain: Array = ((residuals**2 - (residuals - foretold)**2) / scale).mean(1)
    return gain


def names_of(covariates: Sequence[Covariate], leaning: Array) -> tuple[str, ...]:
    """Return terms that follow the most important covariate, flight first; none if no term follows it."""
    most = covariates[int(leaning.argmax())]
    followed = {what for what, columns in FOLLOWED.items() if set(columns) & set(most.names)}
    terms = [term for term in TERMS if getattr(term, "follows", None) in followed]
    return tuple(term.name for term in sorted(terms, key=lambda term: term.stage != "flight"))


def learn_process(covariates: Array, residuals: Array) -> Learnt:
    """Train scikit-learn's Gaussian process: anisotropic RBF plus white noise.

    Hyperparameters by marginal likelihood, climbed from START (one kernel for the three coordinates, each
    standardised). It leans most on the covariate with the shortest length scale, all being standardised.
    """
    length, share, noise = START
    kernel = (ConstantKernel(share, SHARES) * RBF(np.full(covariates.shape[1], length), SCALES)
              + WhiteKernel(noise, SHARES))
    process = GaussianProcessRegressor(kernel, alpha=1e-8, optimizer=_climb, normalize_y=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")           # a length scale at its bound is a covariate that does not matter
        process.fit(covariates, residuals)
    return Learnt(lambda asked: process.predict(asked).reshape(len(asked), -1),
                  lambda: 1.0 / np.atleast_1d(process.kernel_.k1.k2.length_scale))


def _climb(cost: Callable[[Array], tuple[float, Array]], start: Array, bounds: Array) -> tuple[Array, float]:
    """scikit-learn's own optimizer, but no farther than CLIMB."""
    found = minimize(cost, start, method="L-BFGS-B", jac=True, bounds=Bounds(*bounds.T), options={"maxiter": CLIMB})
    return found.x, found.fun


def answer_gp(dataset: Dataset, believed: RivalBelief, seed: int = 0) -> Claim:
    """Return the claim of the Gaussian process; nothing in it is random."""
    return claim_by(dataset, believed, learn_process)


def learn_trees(seed: int, covariates: Array, residuals: Array) -> Learnt:
    """Train scikit-learn's gradient-boosted trees, one set per coordinate; one thread, for worlds run side by side.

    Small trees and a slow rate, as many as an inner validation share finds useful. It leans most on the covariate whose
    shuffling worsens the squared error of what it says of its own shots most, the coordinates alike.
    """
    with threadpool_limits(1):
        models = [HistGradientBoostingRegressor(
            learning_rate=RATE, max_iter=TREES, max_leaf_nodes=LEAVES, min_samples_leaf=LEAST_SHOTS,
            early_stopping=True, validation_fraction=INNER, n_iter_no_change=PATIENCE,
            random_state=seed).fit(covariates, column) for column in residuals.T]

    def predict(asked: Array) -> Array:
        with threadpool_limits(1):
            return np.stack([model.predict(asked) for model in models], axis=1)

    def leaning() -> Array:
        rng, worse = np.random.default_rng(seed), []
        for k in range(covariates.shape[1]):
            shuffled = covariates.copy()
            shuffled[:, k] = rng.permutation(shuffled[:, k])
            worse.append((((residuals - predict(shuffled))**2).mean(0) / residuals.var(axis=0)).mean())
        return np.array(worse)

    return Learnt(predict, leaning)


def answer_boosted(dataset: Dataset, believed: RivalBelief, seed: int = 0) -> Claim:
    """Return the claim of the boosted trees."""
    return claim_by(dataset, believed, partial(learn_trees, seed))


# --- calibration

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
        """Return [n, p] in 0..1 of the runs."""
        scaled: Array = (x - self.low[:self.inputs]) / self.range[:self.inputs]
        return scaled

    def at(self, scaled: Array, theta: Array) -> tuple[Array, Array]:
        """Return (means [n], covariance [n, n]) at scaled inputs [n, p] and parameters [q]."""
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
        """Return [q, 3]: low end, median and high end of each parameter's 90 % interval, in the runs' units."""
        quantiles = np.quantile(self._samples[:, :self._count], (0.05, 0.5, 0.95), axis=0).T
        own: Array = self._emulator.low[-self._count:, None] + self._emulator.range[-self._count:, None] * quantiles
        return own

    def forecast(self, x: Array) -> Forecast:
        """Forecast a measurement at each of the inputs [k, p]."""
        return self._draw(x, False)

    def discrepancy(self, x: Array) -> Forecast:
        """Return the simulator's error at each of the inputs [k, p]."""
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
    """Return [steps after BURN / THIN, d] by Metropolis; until BURN the step follows the chain's covariance (Haario
    2001)."""
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
