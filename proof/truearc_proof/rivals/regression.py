"""From a tuned sparse regression to a claim: names by inclusion, and forecasts of tracks' ends by the law it found."""

import numpy as np

from truearc_proof.rivals.claim import Array, Claim, folds, rms
from truearc_proof.rivals.forecast import end_errors
from truearc_proof.rivals.library import COLUMNS, FREE, terms_of
from truearc_proof.rivals.sparse import INCLUDED, Rows, Tuning, fit, inclusion, rank, tune
from truearc_proof.rivals.tracks import Flights


def known_of(terms: tuple[str, ...]) -> tuple[str, ...]:
    """Columns that are believed: drag and lift, where they are."""
    return tuple(name for name in FREE if name in terms)


def claim_by(flights: Flights, rows: Rows, known: tuple[str, ...], seed: int) -> Claim:
    """Tune, bag, rank, and forecast held-out tracks with a law that the other tracks gave."""
    candidates = tuple(name for name in COLUMNS if name not in known)
    tuning = tune(rows)
    share, size = inclusion(rows, tuning, seed)
    says = bool((share > INCLUDED).any())
    names = tuple(term for column in rank(share, size, candidates) for term in terms_of(column)) if says else ()
    before, after = (rms(end_errors(flights, known + candidates, weights)) for weights in _laws(flights, rows, tuning))
    return Claim(says, names, before, after if says else before,
                 {"threshold": tuning.threshold, "ridge": tuning.ridge, "inclusion": float(share.max())})


def _laws(flights: Flights, rows: Rows, tuning: Tuning) -> tuple[Array, Array]:
    """Coefficients [n, B + K] for each track by the other folds' tracks: believed alone, and with what STLSQ keeps."""
    plain, full = np.zeros((2, len(flights), rows.believed.shape[1] + rows.candidates.shape[1]))
    for held in folds(len(flights)):
        train = rows.take(held.train[rows.track])
        if rows.believed.shape[1]:
            plain[held.out, :rows.believed.shape[1]] = np.linalg.lstsq(train.believed, train.target, rcond=None)[0]
        full[held.out] = np.concatenate(fit(train, tuning))
    return plain, full
