"""PySINDy's sparse regressions of accelerations: the ensemble (E-SINDy) and the weak form.

PySINDy fits separate coefficients for every component, but a force has the same coefficient in all three, so the
components are stacked as rows of one target. The believed columns are first projected out of the target and the
candidates. This is equivalent to keeping them (Frisch-Waugh), which EnsembleOptimizer cannot do (STLSQ's sparse_ind
hides them from it). STLSQ's threshold and ridge are chosen by cross-validation, and 50 models are fitted to rows drawn
with replacement. An entrant makes a claim if the median of the models keeps a candidate, and it ranks candidates by the
share of models that keep them.

The ensemble uses smoothed finite differences: Savitzky-Golay windows of WINDOW frames (the best of 11, 21 and
whole-track polynomials on development worlds), without the frames closer to an end than EDGE. Velocities are
differenced once and accelerations twice; both are treated as exact.

The weak form integrates the law against test functions, so that accelerations are never computed. Each track
contributes DOMAINS stretches of time, which are placed at random and extend HALF of the track to either side of their
middle. PySINDy's WeakPDELibrary integrates the library and the velocity over them against (1 - s^2)^2 and its
derivative. On development worlds, one stretch of almost the whole track was the best choice (of one stretch or four to
six, with powers 2 and 4). This is expected: among such weights, it has the second derivative that is most informative
about a constant acceleration under white noise. The integrated velocity is PySINDy's plain finite difference, whose
noise cancels from frame to frame, which leaves the position against the second derivative. The library uses the
smoothed velocity, whose noise does not cancel.
"""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

from truearc.sim.data.dataset import Dataset
from truearc.sim.infer.likelihood.score_table import FOLDS
from truearc_proof.rivals import claim as laws
from truearc_proof.rivals.claim import Array, Claim, RivalBelief

THRESHOLDS = np.geomspace(0.02, 5.0, 13)      # in usual sizes of a term
RIDGES = (0.05, 5.0, 500.0)           # PySINDy's own default, and two that damp what all but runs alike
MODELS = 50                           # of the ensemble
INCLUDED = 0.5                        # share of models from which the ensemble's median has a term: it is said
WINDOW, ORDER = 21, 3
EDGE = 8
HALF = 0.49                           # of the track's length, to either side of a domain's centre
DOMAINS = 1                           # a track
POWER = 2                             # of the test function


class Rows(NamedTuple):
    """A regression: target [R], believed columns [R, B], candidates [R, K], and the track of each row [R]."""

    target: Array
    believed: Array
    candidates: Array
    track: Array

    def take(self, rows: Array) -> "Rows":
        """Return rows under a mask."""
        return Rows(*(part[rows] for part in self))


class Tuning(NamedTuple):
    """Tuning parameters of STLSQ."""

    threshold: float
    ridge: float


class Model(NamedTuple):
    """Coefficients of believed columns [B] and candidates [K]."""

    believed: Array
    candidates: Array


def tune(rows: Rows) -> Tuning:
    """Tune by five-fold cross-validation over whole tracks.

    Returns the ridge with the least error on held-out rows, and with it the highest threshold whose error is within one
    standard error (over tracks) of the least.
    """
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
    """Fit one STLSQ."""
    target, candidates = project(rows)
    optimizer = _stlsq(tuning)
    with _quiet():
        optimizer.fit(candidates, target[:, None])
    found = np.asarray(optimizer.coef_)[0]
    left = rows.target - rows.candidates @ found
    return Model(np.linalg.lstsq(rows.believed, left, rcond=None)[0], found)


def ensemble(rows: Rows, tuning: Tuning, seed: int, models: int = MODELS) -> Array:
    """Return [models, K]: the candidates' coefficients in each of the ensemble's models."""
    import pysindy

    target, candidates = project(rows)
    optimizer = pysindy.EnsembleOptimizer(_stlsq(tuning), bagging=True, n_models=models)
    with _quiet(), seeded(seed):
        optimizer.fit(candidates, target[:, None])
    return np.array(optimizer.coef_list)[:, 0]


def rank(share: Array, size: Array, names: tuple[str, ...]) -> tuple[str, ...]:
    """Return names that any model includes, by share, then by size in usual sizes."""
    order = sorted(range(len(names)), key=lambda k: (-share[k], -abs(size[k])))
    return tuple(names[k] for k in order if share[k] > 0.0)


def project(rows: Rows) -> tuple[Array, Array]:
    """Return (target, candidates) with what the believed columns explain projected out."""
    both = np.column_stack([rows.target, rows.candidates])
    left = both - rows.believed @ np.linalg.lstsq(rows.believed, both, rcond=None)[0]
    return left[:, 0], left[:, 1:]


def compress(rows: Rows) -> Rows:
    """Return as few rows as there are columns, with the same least squares: the triangle of their QR factors."""
    width = rows.believed.shape[1]
    # NumPy's annotations promise a pair in every mode
    triangle = np.asarray(np.linalg.qr(np.column_stack([rows.believed, rows.candidates, rows.target]), mode="r"))
    return Rows(triangle[:, -1], triangle[:, :width], triangle[:, width:-1], np.zeros(len(triangle), dtype=int))


@contextmanager
def seeded(seed: int) -> Iterator[None]:
    """Seed NumPy's global generator, which PySINDy draws from, and restore it afterwards."""
    state = np.random.get_state()
    np.random.seed(seed % 2**32)
    try:
        yield
    finally:
        np.random.set_state(state)


def _stlsq(tuning: Tuning) -> Any:
    import pysindy

    return pysindy.STLSQ(threshold=tuning.threshold, alpha=tuning.ridge)


@contextmanager
def _quiet() -> Iterator[None]:
    """Without PySINDy's word that a threshold left nothing: that is an answer."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def known_of(terms: tuple[str, ...]) -> tuple[str, ...]:
    """Return the believed columns: drag and lift, if present."""
    return tuple(name for name in laws.FREE if name in terms)


def claim_by(rows: Rows, known: tuple[str, ...], seed: int) -> Claim:
    """Tune, bag and rank."""
    models = ensemble(rows, tune(rows), seed)
    share = (models != 0.0).mean(0)
    if not (share > INCLUDED).any():
        return Claim(False)
    ranked = rank(share, np.median(models, axis=0), laws.candidates_of(known))
    return Claim(True, tuple(term for column in ranked for term in laws.terms_of(column)))


def answer_ensemble(dataset: Dataset, believed: RivalBelief, seed: int = 0) -> Claim:
    """Return the claim of the ensemble; needs pysindy."""
    known = known_of(believed.terms)
    return claim_by(ensemble_rows(laws.gather_flights(dataset), known), known, seed)


def answer_weak(dataset: Dataset, believed: RivalBelief, seed: int = 0) -> Claim:
    """Return the claim of the ensemble over the weak form; needs pysindy."""
    known = known_of(believed.terms)
    return claim_by(weak_rows(laws.gather_flights(dataset), known, seed), known, seed)


def ensemble_rows(flights: laws.Flights, known: tuple[str, ...]) -> Rows:
    """Return each frame's measured accelerations without gravity, and the library at its velocity."""
    def rows_of(time_s: Array, position_m: Array, velocity: Array, columns: Array) -> tuple[Array, Array]:
        inner = slice(EDGE, len(time_s) - EDGE)
        return columns[inner], (differentiate(velocity, time_s) - laws.gravity(flights.facts))[inner]

    return _gather_rows(flights, known, rows_of)


def weak_rows(flights: laws.Flights, known: tuple[str, ...], seed: int) -> Rows:
    """Return integrals over every domain of the measured components; tracks with the same times share their domains."""
    from pysindy import FiniteDifference

    libraries: dict[bytes, object] = {}

    def rows_of(time_s: Array, position_m: Array, velocity: Array, columns: Array) -> tuple[Array, Array]:
        key = np.round(time_s, 6).tobytes()
        if key not in libraries:
            libraries[key] = _domains(time_s, seed + len(libraries))
        pulled = np.broadcast_to(laws.gravity(flights.facts), position_m.shape)
        integrals = integrate(libraries[key], np.concatenate([columns.reshape(len(time_s), -1), pulled], axis=1))
        moved = change(libraries[key], np.asarray(FiniteDifference()._differentiate(position_m, time_s)))
        return integrals[:, :-3].reshape(-1, *columns.shape[1:]), moved - integrals[:, -3:]

    return _gather_rows(flights, known, rows_of)


def _gather_rows(flights: laws.Flights, known: tuple[str, ...],
                 rows_of: Callable[[Array, Array, Array, Array], tuple[Array, Array]]) -> Rows:
    """Rows of the tracks that are long enough, of measured components.

    rows_of: from times [T], positions and velocities [T, 3] and the library's columns [T, 3, K] of a track to columns
    [r, 3, K] and targets [r, 3].
    """
    names = known + laws.candidates_of(known)
    library, target, track = [], [], []
    for k in range(len(flights)):
        time_s, position_m = flights.filled(k)
        if len(time_s) < WINDOW:
            continue
        velocity = differentiate(position_m, time_s)
        at = flights.moments(k, time_s, velocity)
        columns, wanted = rows_of(time_s, position_m, velocity, laws.accelerations(flights.facts, names, at))
        library.append(columns[:, flights.measured].reshape(-1, len(names)))
        target.append(wanted[:, flights.measured].ravel())
        track.append(np.full(len(target[-1]), k))
    whole = np.concatenate(library)
    return Rows(np.concatenate(target), whole[:, :len(known)], whole[:, len(known):], np.concatenate(track))


def differentiate(values: Array, time_s: Array) -> Array:
    """Return derivatives of columns [T, 3] by PySINDy's smoothed finite difference."""
    from pysindy import SmoothedFiniteDifference

    method = SmoothedFiniteDifference(smoother_kws={"window_length": WINDOW, "polyorder": ORDER})
    return np.asarray(method._differentiate(values, time_s))


def _domains(time_s: Array, seed: int) -> Any:
    import pysindy

    with seeded(seed):
        return pysindy.WeakPDELibrary(function_library=pysindy.IdentityLibrary(), spatiotemporal_grid=time_s,
                                      K=DOMAINS, H_xt=[HALF * (time_s[-1] - time_s[0])], p=POWER)


def integrate(library: Any, columns: Array) -> Array:
    """Return [DOMAINS, k] integrals of columns [T, k] against the test functions.

    Uses PySINDy's weights without its transform, which recomputes names and polynomials for every track and takes a
    hundred times as long.
    """
    return np.stack([weight @ columns[inside[0]] for weight, inside in zip(library.fullweights0, library.inds_k,
                                                                           strict=True)])


def change(library: Any, columns: Array) -> Array:
    """Return [DOMAINS, k] integrals of the columns' derivatives, by parts."""
    from pysindy.utils import AxesArray

    return np.asarray(library.convert_u_dot_integral(AxesArray(columns, {"ax_time": 0, "ax_coord": 1})))
