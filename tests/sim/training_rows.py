"""Rows to train on in tests."""

import numpy as np

from truearc.sim.paper.network import Rows


def some_rows(count: int, seed: int) -> Rows:
    """Shots whose outcome depends on distance and speed alone."""
    rng = np.random.default_rng(seed)
    features = np.column_stack([rng.uniform(2, 9, count), rng.uniform(0.3, 0.9, count), rng.uniform(20, 70, count)])
    reach = 12.0 * features[:, 1] - features[:, 0]
    return Rows(features, np.column_stack([reach > 1.0, reach > 3.0]).astype(float))


def sigmoid(z: np.ndarray) -> np.ndarray:
    return 1.0 / (1.0 + np.exp(-z))


REAL, SIMULATED = some_rows(23, 1), some_rows(47, 2)
