"""Rivals that model the simulator's residual with a learner.

A shot's residual is the difference, in three coordinates, between its track's last sample and the forecast from the
first 40 % of its samples by the believed physics, fitted to the other folds. The covariates are all columns that
truearc tests (configuration, launch state, circumstances, telemetry). A learner has no terms of its own. If its most
important covariate is one that terms of the catalogue follow from shot to shot (air density, age of the ball, battery,
...), it names those terms, flight terms first, since the first samples determine the launch. A dozen terms depend on
distance, elevation, speed or spin; for these covariates it names nothing.
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
from truearc_proof.rivals.claim import Array, Claim, RivalBelief, folds

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
    says = bool(gain_of_each(residuals, foretold).mean() > 0.0)
    return Claim(says, names_of(covariates, learn(table, residuals).leaning()) if says else ())


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
