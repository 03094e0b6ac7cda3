"""A rival that models the simulator's residual with a Gaussian process.

A shot's residual is the difference, in three coordinates, between its track's last sample and the forecast from the
first 40 % of its samples by the believed physics, fitted to the other folds. The covariates are all columns that
truearc tests (configuration, launch state, circumstances, telemetry). The process has no terms of its own. If its most
important covariate is one that terms of the catalogue follow from shot to shot (air density, age of the ball, battery,
...), it names those terms, flight terms first, since the first samples determine the launch. A dozen terms depend on
distance, elevation, speed or spin; for these covariates it names nothing.
"""

import warnings
from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import Bounds, minimize
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from truearc.sim.data.dataset import Dataset
from truearc.sim.discover.detect.covariates import FOLLOWED, Covariate, gather_covariates
from truearc.sim.discover.select.simulations import track_errors
from truearc.sim.infer.likelihood.score_table import FOLDS, folds_of
from truearc.sim.physics.catalogue import TERMS
from truearc_proof.rivals.claim import Array, Claim, RivalBelief

SCALES = (0.1, 1e3)                   # of length, in standard deviations of a covariate
SHARES = (1e-4, 1e2)                  # of variance, in the residuals' own
START = (3.0, 0.3, 0.7)               # length scale, share of the process, share of the noise
CLIMB = 25                            # of the climb: a longer one, where tried, made more of noise, at thrice the cost


def answer_gp(dataset: Dataset, believed: RivalBelief, seed: int = 0) -> Claim:
    """Return its claim; it says something if it forecasts held-out residuals better than 0. Nothing in it is random."""
    covariates = gather_covariates(dataset)
    residuals = residuals_of(believed)
    table = table_of(covariates, believed.fitted.model.data.rows[believed.fitted.model.data.tracked])
    says = gain(residuals, cross_validate(table, residuals)) > 0.0
    return Claim(says, names_of(covariates, leaning(learn(table, residuals))) if says else ())


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


def cross_validate(table: Array, residuals: Array) -> Array:
    """Return [k, 3]: every fifth shot's residuals as forecast from the others."""
    foretold, fold = np.zeros_like(residuals), folds_of(len(table))
    for k in range(FOLDS):
        process = learn(table[fold != k], residuals[fold != k])
        foretold[fold == k] = process.predict(table[fold == k]).reshape(-1, residuals.shape[1])
    return foretold


def gain(residuals: Array, foretold: Array) -> float:
    """Return the share by which the forecast reduces the squared error, coordinates weighted equally."""
    return float(1.0 - (((residuals - foretold)**2).mean(0) / (residuals**2).mean(0)).mean())


def names_of(covariates: Sequence[Covariate], leaning: Array) -> tuple[str, ...]:
    """Return terms that follow the most important covariate, flight first; none if no term follows it."""
    most = covariates[int(leaning.argmax())]
    followed = {what for what, columns in FOLLOWED.items() if set(columns) & set(most.names)}
    terms = [term for term in TERMS if getattr(term, "follows", None) in followed]
    return tuple(term.name for term in sorted(terms, key=lambda term: term.stage != "flight"))


def learn(covariates: Array, residuals: Array) -> GaussianProcessRegressor:
    """Train scikit-learn's Gaussian process: anisotropic RBF plus white noise.

    Hyperparameters by marginal likelihood, climbed from START (one kernel for the three coordinates, each
    standardised).
    """
    length, share, noise = START
    kernel = (ConstantKernel(share, SHARES) * RBF(np.full(covariates.shape[1], length), SCALES)
              + WhiteKernel(noise, SHARES))
    process = GaussianProcessRegressor(kernel, alpha=1e-8, optimizer=_climb, normalize_y=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")           # a length scale at its bound is a covariate that does not matter
        process.fit(covariates, residuals)
    return process


def leaning(process: GaussianProcessRegressor) -> Array:
    """Return [q]: how much it leans on each covariate, the inverse of its length scale; all are standardised."""
    return 1.0 / np.atleast_1d(process.kernel_.k1.k2.length_scale)


def _climb(cost: Callable[[Array], tuple[float, Array]], start: Array, bounds: Array) -> tuple[Array, float]:
    """scikit-learn's own optimizer, but no farther than CLIMB."""
    found = minimize(cost, start, method="L-BFGS-B", jac=True, bounds=Bounds(*bounds.T), options={"maxiter": CLIMB})
    return found.x, found.fun
