"""A Gaussian process on the believed fit's residuals: Kennedy & O'Hagan's discrepancy, by scikit-learn.

Anisotropic RBF plus white noise, hyperparameters by marginal likelihood (one kernel for the three coordinates, each
standardised). It leans most on the covariate with the shortest length scale, all covariates being standardised.
"""

import warnings
from collections.abc import Callable

import numpy as np
from scipy.optimize import Bounds, minimize
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from truearc.sim.data.dataset import Dataset
from truearc_proof.rivals.claim import Array, Claim, RivalBelief
from truearc_proof.rivals.residual import claim_by

SCALES = (0.1, 1e3)                   # of length, in standard deviations of a covariate
SHARES = (1e-4, 1e2)                  # of variance, in the residuals' own
START = (3.0, 0.3, 0.7)               # length scale, share of the process, share of the noise
STEPS = 25                            # of the climb: a longer one, where tried, made more of noise, at thrice the cost


class Process:
    """scikit-learn's, as a Learner."""

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


def answer(dataset: Dataset, believed: RivalBelief, seed: int = 0) -> Claim:
    """Return the claim of the Gaussian process; nothing in it is random."""
    return claim_by(dataset, believed, Process)
