"""Learners of the residual (Kennedy & O'Hagan's discrepancy): a Gaussian process, and gradient-boosted trees.

A shot's residual are three coordinates of its track's last sample less the forecast by the believed physics, fitted to
the other folds, from the first 40 % of its samples. Covariates: every column that truearc itself asks about
(configuration, launch state, circumstances, telemetry). Such a learner has no terms to name. It names what it can in
honesty: where the covariate that it leans on most is one that terms of the catalogue follow from shot to shot (the
air's density, the ball's age, the battery, ...), those terms, flight first, since the first samples determine the
launch; on distance, elevation, speed or spin a dozen terms depend, and it names nothing.
"""

import warnings
from collections.abc import Callable, Sequence
from functools import partial
from typing import Protocol

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

SCALES = (0.1, 1e3)                   # of length, in standard deviations of a covariate
SHARES = (1e-4, 1e2)                  # of variance, in the residuals' own
START = (3.0, 0.3, 0.7)               # length scale, share of the process, share of the noise
STEPS = 25                            # of the climb: a longer one, where tried, made more of noise, at thrice the cost
TREES, RATE, LEAVES, LEAST_SHOTS = 300, 0.05, 8, 15
INNER, PATIENCE = 0.2, 15             # share of shots that say when to stop, and trees without gain until then


class Learner(Protocol):
    """A regression of residuals [n, 3] on covariates [n, q]."""

    def fit(self, covariates: Array, residuals: Array) -> "Learner":
        """Learn."""

    def predict(self, covariates: Array) -> Array:
        """[n, 3]."""

    def leaning(self) -> Array:
        """[q] how much it leans on each covariate, most = largest."""


def claim_by(dataset: Dataset, believed: RivalBelief, make: Callable[[], Learner]) -> Claim:
    """Return the learner's claim; it says something if it forecasts held-out residuals better than 0 does."""
    covariates = gather_covariates(dataset)
    residuals = residuals_of(believed)
    table = table_of(covariates, believed.fitted.model.data.rows[believed.fitted.model.data.tracked])
    foretold = cross_validate(table, residuals, make)
    each = gain_of_each(residuals, foretold)
    says = bool(each.mean() > 0.0)
    names = names_of(covariates, make().fit(table, residuals).leaning()) if says else ()
    left = residuals - foretold if says else residuals
    return Claim(says, names, rms(residuals[:, -1]), rms(left[:, -1]),
                 {"gain": float(each.mean()), "gain_se": float(each.std() / np.sqrt(len(each)))})


def residuals_of(believed: RivalBelief) -> Array:
    """[k, c] in m of the tracked shots' measured coordinates, height last, each by a believed fit that has not seen
    it."""
    null = believed.fitted.without_terms()
    errors = track_errors(null, null.scores.held_out_change())
    return errors[:, (errors != 0.0).any(axis=0)]


def table_of(covariates: Sequence[Covariate], rows: Array) -> Array:
    """[k, q] standardised, unknown = 0 (the mean)."""
    values = np.stack([covariate.values[rows] for covariate in covariates], axis=1)
    spread = np.nanstd(values, axis=0)
    table: Array = np.nan_to_num((values - np.nanmean(values, axis=0)) / np.where(spread > 0.0, spread, 1.0))
    return table


def cross_validate(table: Array, residuals: Array, make: Callable[[], Learner]) -> Array:
    """[k, 3] each fold's residuals as forecast from the other folds."""
    foretold = np.zeros_like(residuals)
    for held in folds(len(table)):
        foretold[held.out] = make().fit(table[held.train], residuals[held.train]).predict(table[held.out])
    return foretold


def gain_of_each(residuals: Array, foretold: Array) -> Array:
    """[k] what each shot's squared error loses by the forecast, as a share of the mean, the coordinates alike."""
    scale = np.mean(residuals**2, axis=0)
    gain: Array = ((residuals**2 - (residuals - foretold)**2) / scale).mean(1)
    return gain


def names_of(covariates: Sequence[Covariate], leaning: Array) -> tuple[str, ...]:
    """Terms that follow the covariate leant on most, flight first; none where no term follows it."""
    most = covariates[int(leaning.argmax())]
    followed = {what for what, columns in FOLLOWED.items() if set(columns) & set(most.names)}
    terms = [term for term in TERMS if getattr(term, "follows", None) in followed]
    return tuple(term.name for term in sorted(terms, key=lambda term: term.stage != "flight"))


class Process:
    """scikit-learn's Gaussian process, as a Learner.

    Anisotropic RBF plus white noise, hyperparameters by marginal likelihood (one kernel for the three coordinates, each
    standardised). It leans most on the covariate with the shortest length scale, all being standardised.
    """

    def __init__(self) -> None:
        self._process: GaussianProcessRegressor | None = None

    def fit(self, covariates: Array, residuals: Array) -> "Process":
        """Climb the marginal likelihood from START."""
        length, share, noise = START
        kernel = (ConstantKernel(share, SHARES) * RBF(np.full(covariates.shape[1], length), SCALES)
                  + WhiteKernel(noise, SHARES))
        self._process = GaussianProcessRegressor(kernel, alpha=1e-8, optimizer=_climb, normalize_y=True)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")       # a length scale at its bound is a covariate that does not matter
            self._process.fit(covariates, residuals)
        return self

    def predict(self, covariates: Array) -> Array:
        """Posterior means."""
        assert self._process is not None
        mean: Array = self._process.predict(covariates).reshape(len(covariates), -1)
        return mean

    def leaning(self) -> Array:
        """1 / length scale."""
        assert self._process is not None
        return 1.0 / np.atleast_1d(self._process.kernel_.k1.k2.length_scale)


def _climb(cost: Callable[[Array], tuple[float, Array]], start: Array, bounds: Array) -> tuple[Array, float]:
    """scikit-learn's own optimizer, but no farther than STEPS."""
    found = minimize(cost, start, method="L-BFGS-B", jac=True, bounds=Bounds(*bounds.T), options={"maxiter": STEPS})
    return found.x, found.fun


def answer_gp(dataset: Dataset, believed: RivalBelief, seed: int = 0) -> Claim:
    """Return the claim of the Gaussian process; nothing in it is random."""
    return claim_by(dataset, believed, Process)


class Trees:
    """scikit-learn's gradient-boosted trees, one set of them a coordinate, as a Learner.

    Small trees and a slow rate, as many as an inner validation share finds useful. It leans most on the covariate whose
    shuffling worsens what it says of its own shots most.
    """

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._models: list[HistGradientBoostingRegressor] = []
        self._learnt: tuple[Array, Array] | None = None

    def fit(self, covariates: Array, residuals: Array) -> "Trees":
        """One model for each coordinate; one thread, for worlds run side by side."""
        with threadpool_limits(1):
            self._models = [HistGradientBoostingRegressor(
                learning_rate=RATE, max_iter=TREES, max_leaf_nodes=LEAVES, min_samples_leaf=LEAST_SHOTS,
                early_stopping=True, validation_fraction=INNER, n_iter_no_change=PATIENCE,
                random_state=self._seed).fit(covariates, residuals[:, k]) for k in range(residuals.shape[1])]
        self._learnt = covariates, residuals
        return self

    def predict(self, covariates: Array) -> Array:
        """[n, 3]."""
        with threadpool_limits(1):
            return np.stack([model.predict(covariates) for model in self._models], axis=1)

    def leaning(self) -> Array:
        """By how much shuffling each covariate worsens the squared error, the coordinates alike."""
        assert self._learnt is not None
        covariates, residuals = self._learnt
        rng = np.random.default_rng(self._seed)
        scale = residuals.var(axis=0)
        worse = []
        for k in range(covariates.shape[1]):
            shuffled = covariates.copy()
            shuffled[:, k] = rng.permutation(shuffled[:, k])
            worse.append((((residuals - self.predict(shuffled))**2).mean(0) / scale).mean())
        return np.array(worse)


def answer_boosted(dataset: Dataset, believed: RivalBelief, seed: int = 0) -> Claim:
    """Return the claim of the boosted trees."""
    return claim_by(dataset, believed, partial(Trees, seed))
