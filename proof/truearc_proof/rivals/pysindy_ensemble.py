"""PySINDy on accelerations: smoothed finite differences, an ensemble of sparse regressions (E-SINDy).

Tuning: Savitzky-Golay windows of WINDOW frames (the best of 11, 21 and whole-track polynomials on development worlds),
frames nearer to an end than EDGE left out, STLSQ's threshold and ridge by cross-validation (sparse.tune), 50 models on
rows drawn with replacement. It says something when the median of the models keeps a candidate, and ranks candidates by
the share of models that do. Velocities are differenced once and accelerations twice; both are treated as exact.
"""

import numpy as np

from truearc.sim.data.dataset import Dataset
from truearc_proof.rivals.claim import Array, Claim, RivalBelief
from truearc_proof.rivals.library import accelerations, candidates_of, gravity
from truearc_proof.rivals.regression import claim_by, known_of
from truearc_proof.rivals.sparse import Rows
from truearc_proof.rivals.tracks import Flights, gather_flights

WINDOW, ORDER = 21, 3
EDGE = 8


def answer(dataset: Dataset, believed: RivalBelief, seed: int = 0) -> Claim:
    """Return the claim of the ensemble; needs pysindy."""
    flights = gather_flights(dataset)
    known = known_of(believed.terms)
    return claim_by(flights, rows_of(flights, known), known, seed)


def rows_of(flights: Flights, known: tuple[str, ...]) -> Rows:
    """Each frame's measured accelerations without gravity, against the library at its velocity."""
    names = known + candidates_of(known)
    library, target, track = [], [], []
    for k in range(len(flights)):
        time_s, position_m = flights.filled(k)
        if len(time_s) < WINDOW:
            continue
        velocity = differentiate(position_m, time_s)
        away = differentiate(velocity, time_s) - gravity(flights.facts)
        inner = slice(EDGE, len(time_s) - EDGE)
        columns = accelerations(flights.facts, names, flights.moments(k, time_s, velocity))
        library.append(columns[inner][:, flights.measured].reshape(-1, len(names)))
        target.append(away[inner][:, flights.measured].ravel())
        track.append(np.full(len(target[-1]), k))
    whole = np.concatenate(library)
    return Rows(np.concatenate(target), whole[:, :len(known)], whole[:, len(known):], np.concatenate(track))


def differentiate(values: Array, time_s: Array) -> Array:
    """Derivatives of columns [T, 3] by PySINDy's smoothed finite difference."""
    from pysindy import SmoothedFiniteDifference

    method = SmoothedFiniteDifference(smoother_kws={"window_length": WINDOW, "polyorder": ORDER})
    return np.asarray(method._differentiate(values, time_s))
