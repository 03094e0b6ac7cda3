"""Gradient-boosted trees on the believed fit's residuals, by scikit-learn: one set of trees a coordinate.

Small trees and a slow rate, as many as an inner validation share finds useful. It leans most on the covariate whose
shuffling worsens what it says of its own shots most.
"""

from functools import partial

import numpy as np
from sklearn.ensemble import HistGradientBoostingRegressor
from threadpoolctl import threadpool_limits

from truearc.sim.data.dataset import Dataset
from truearc_proof.rivals.claim import Array, Claim, RivalBelief
from truearc_proof.rivals.residual import claim_by

TREES, RATE, LEAVES, LEAST_SHOTS = 300, 0.05, 8, 15
INNER, PATIENCE = 0.2, 15             # share of shots that say when to stop, and trees without gain until then


class Trees:
    """scikit-learn's, as a Learner."""

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


def answer(dataset: Dataset, believed: RivalBelief, seed: int = 0) -> Claim:
    """Return the claim of the boosted trees."""
    return claim_by(dataset, believed, partial(Trees, seed))
