"""PySINDy's optimizers on a library of vector columns that share their coefficients, what is believed always kept.

PySINDy fits every component its own coefficients; a force has one for all three, so the components are stacked as rows
of one target. The believed columns are projected out of target and candidates first: keeping them is the same
(Frisch-Waugh), and EnsembleOptimizer cannot hold columns itself (STLSQ's sparse_ind hides them from it).
"""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

from truearc_proof.rivals.claim import FOLDS, Array

THRESHOLDS = np.geomspace(0.02, 5.0, 13)      # in usual sizes of a term
RIDGES = (0.05, 5.0, 500.0)           # PySINDy's own default, and two that damp what all but runs alike
MODELS = 50                           # of the ensemble
INCLUDED = 0.5                        # share of models from which the ensemble's median has a term: it is said


class Rows(NamedTuple):
    """A regression: target [R], believed columns [R, B], candidates [R, K], and the track of each row [R]."""

    target: Array
    believed: Array
    candidates: Array
    track: Array

    def take(self, rows: Array) -> "Rows":
        """Rows under a mask."""
        return Rows(*(part[rows] for part in self))


class Tuning(NamedTuple):
    """Of STLSQ."""

    threshold: float
    ridge: float


class Model(NamedTuple):
    """Coefficients of believed columns [B] and candidates [K]."""

    believed: Array
    candidates: Array


def tune(rows: Rows) -> Tuning:
    """By five-fold cross-validation over whole tracks: the ridge with the least error on held-out rows, and with it the
    highest threshold whose error is within one standard error (over tracks) of the least."""
    grid = [Tuning(float(threshold), ridge) for ridge in RIDGES for threshold in THRESHOLDS]
    square = np.zeros((len(grid), int(rows.track.max()) + 1))
    for fold in range(FOLDS):
        out = rows.track % FOLDS == fold
        small = compress(rows.take(~out))
        test = rows.take(out)
        for number, tuning in enumerate(grid):
            model = fit(small, tuning)
            off = test.target - test.believed @ model.believed - test.candidates @ model.candidates
            np.add.at(square[number], test.track, off**2)
    best = int(square.sum(1).argmin())
    worse = square - square[best]
    error = worse.std(axis=1) * np.sqrt(square.shape[1])
    return max((grid[k] for k in range(len(grid)) if worse[k].sum() <= error[k] and grid[k].ridge == grid[best].ridge),
               key=lambda tuning: tuning.threshold)


def fit(rows: Rows, tuning: Tuning) -> Model:
    """One STLSQ."""
    target, candidates = project(rows)
    optimizer = _stlsq(tuning)
    with _quiet():
        optimizer.fit(candidates, target[:, None])
    return _whole(rows, np.asarray(optimizer.coef_)[0])


def ensemble(rows: Rows, tuning: Tuning, seed: int, models: int = MODELS) -> Array:
    """[models, K] the candidates' coefficients in each of the ensemble's models."""
    import pysindy

    target, candidates = project(rows)
    optimizer = pysindy.EnsembleOptimizer(_stlsq(tuning), bagging=True, n_models=models)
    with _quiet(), seeded(seed):
        optimizer.fit(candidates, target[:, None])
    return np.array(optimizer.coef_list)[:, 0]


def rank(share: Array, size: Array, names: tuple[str, ...]) -> tuple[str, ...]:
    """Names that any model includes, by share, then by size in usual sizes."""
    order = sorted(range(len(names)), key=lambda k: (-share[k], -abs(size[k])))
    return tuple(names[k] for k in order if share[k] > 0.0)


def project(rows: Rows) -> tuple[Array, Array]:
    """(target, candidates) without what the believed columns can say."""
    both = np.column_stack([rows.target, rows.candidates])
    left = both - rows.believed @ np.linalg.lstsq(rows.believed, both, rcond=None)[0]
    return left[:, 0], left[:, 1:]


def compress(rows: Rows) -> Rows:
    """As few rows as there are columns, with the same least squares: the triangle of their QR factors."""
    width = rows.believed.shape[1]
    # NumPy's annotations promise a pair in every mode
    triangle = np.asarray(np.linalg.qr(np.column_stack([rows.believed, rows.candidates, rows.target]), mode="r"))
    return Rows(triangle[:, -1], triangle[:, :width], triangle[:, width:-1], np.zeros(len(triangle), dtype=int))


@contextmanager
def seeded(seed: int) -> Iterator[None]:
    """NumPy's global generator, which PySINDy draws from, seeded here and as it was afterwards."""
    state = np.random.get_state()
    np.random.seed(seed % 2**32)
    try:
        yield
    finally:
        np.random.set_state(state)


def _whole(rows: Rows, found: Array) -> Model:
    left = rows.target - rows.candidates @ found
    return Model(np.linalg.lstsq(rows.believed, left, rcond=None)[0], found)


def _stlsq(tuning: Tuning) -> Any:
    import pysindy

    return pysindy.STLSQ(threshold=tuning.threshold, alpha=tuning.ridge)


@contextmanager
def _quiet() -> Iterator[None]:
    """Without PySINDy's word that a threshold left nothing: that is an answer."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield
