"""PySINDy's weak form: the law integrated against test functions, so that no acceleration is ever taken.

Each track gives DOMAINS stretches of time placed at random, HALF of the track to either side of their middle; PySINDy's
WeakPDELibrary integrates library and velocity over them against (1 - s^2)^2 and its derivative. One stretch of almost
the whole track was best on development worlds (of one or four to six, powers 2 and 4), as it should be: among such
weights its second derivative says most of a constant acceleration under white noise. The velocity that is integrated
is PySINDy's plain finite difference (its noise cancels from frame to frame: what is left is the position against the
second derivative); the library is taken at the smoothed velocity, which has no such help. Threshold, ridge, ensemble
and what counts as saying something are as in pysindy_ensemble.
"""

from typing import Any

import numpy as np

from truearc.sim.data.dataset import Dataset
from truearc_proof.rivals.claim import Array, Claim, RivalBelief
from truearc_proof.rivals.library import accelerations, candidates_of, gravity
from truearc_proof.rivals.pysindy_ensemble import WINDOW, differentiate
from truearc_proof.rivals.regression import claim_by, known_of
from truearc_proof.rivals.sparse import Rows, seeded
from truearc_proof.rivals.tracks import Flights, gather_flights

HALF = 0.49                           # of the track's length, to either side of a domain's centre
DOMAINS = 1                           # a track
POWER = 2                             # of the test function


def answer(dataset: Dataset, believed: RivalBelief, seed: int = 0) -> Claim:
    """Return the claim of the ensemble over the weak form; needs pysindy."""
    flights = gather_flights(dataset)
    known = known_of(believed.terms)
    return claim_by(flights, rows_of(flights, known, seed), known, seed)


def rows_of(flights: Flights, known: tuple[str, ...], seed: int) -> Rows:
    """Integrals over every domain, of the measured components; tracks of the same times share their domains."""
    from pysindy import FiniteDifference

    names = known + candidates_of(known)
    libraries: dict[bytes, object] = {}
    library, target, track = [], [], []
    for k in range(len(flights)):
        time_s, position_m = flights.filled(k)
        if len(time_s) < WINDOW:
            continue
        columns = accelerations(flights.facts, names, flights.moments(k, time_s, differentiate(position_m, time_s)))
        key = np.round(time_s, 6).tobytes()
        if key not in libraries:
            libraries[key] = _domains(time_s, seed + len(libraries))
        pulled = np.broadcast_to(gravity(flights.facts), position_m.shape)
        integrals = integrate(libraries[key], np.concatenate([columns.reshape(len(time_s), -1), pulled], axis=1))
        moved = change(libraries[key], np.asarray(FiniteDifference()._differentiate(position_m, time_s)))
        library.append(integrals[:, :-3].reshape(-1, 3, len(names))[:, flights.measured].reshape(-1, len(names)))
        target.append((moved - integrals[:, -3:])[:, flights.measured].ravel())
        track.append(np.full(len(target[-1]), k))
    whole = np.concatenate(library)
    return Rows(np.concatenate(target), whole[:, :len(known)], whole[:, len(known):], np.concatenate(track))


def _domains(time_s: Array, seed: int) -> Any:
    import pysindy

    with seeded(seed):
        return pysindy.WeakPDELibrary(function_library=pysindy.IdentityLibrary(), spatiotemporal_grid=time_s,
                                      K=DOMAINS, H_xt=[HALF * (time_s[-1] - time_s[0])], p=POWER)


def integrate(library: Any, columns: Array) -> Array:
    """[DOMAINS, k] integrals of columns [T, k] against the test functions: PySINDy's weights, without its transform,
    which works out names and polynomials for every track again and takes a hundred times as long."""
    return np.stack([weight @ columns[inside[0]] for weight, inside in zip(library.fullweights0, library.inds_k,
                                                                           strict=True)])


def change(library: Any, columns: Array) -> Array:
    """[DOMAINS, k] integrals of the columns' derivatives, by parts."""
    return np.asarray(library.convert_u_dot_integral(_axes(columns)))


def _axes(columns: Array) -> Any:
    from pysindy.utils import AxesArray

    return AxesArray(columns, {"ax_time": 0, "ax_coord": 1})
