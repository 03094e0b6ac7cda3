"""From a tuned sparse regression to a claim: names by inclusion, and forecasts of tracks' ends by the law it found."""

import numpy as np

from truearc_proof.rivals.claim import Array, Claim, folds, rms
from truearc_proof.rivals.forecast import end_errors
from truearc_proof.rivals.library import FREE, candidates_of, terms_of, usual_of
from truearc_proof.rivals.sparse import INCLUDED, Rows, Tuning, ensemble, fit, rank, tune
from truearc_proof.rivals.tracks import Flights


def known_of(terms: tuple[str, ...]) -> tuple[str, ...]:
    """Columns that are believed: drag and lift, where they are."""
    return tuple(name for name in FREE if name in terms)


def claim_by(flights: Flights, rows: Rows, known: tuple[str, ...], seed: int) -> Claim:
    """Tune, bag, rank, and forecast held-out tracks with a law that the other tracks gave.

    figures: low90, high90, the middle nine tenths of the models' coefficients of the first column, in its term's units.
    """
    candidates = candidates_of(known)
    tuning = tune(rows)
    models = ensemble(rows, tuning, seed)
    share = (models != 0.0).mean(0)
    says = bool((share > INCLUDED).any())
    ranked = rank(share, np.median(models, axis=0), candidates) if says else ()
    before, after = (rms(end_errors(flights, known + candidates, weights)) for weights in _laws(flights, rows, tuning))
    figures = {"threshold": tuning.threshold, "ridge": tuning.ridge, "inclusion": float(share.max())}
    for end, quantile in (("low90", 0.05), ("high90", 0.95)) if ranked else ():
        figures[end] = float(usual_of(ranked[0]) * np.quantile(models[:, candidates.index(ranked[0])], quantile))
    return Claim(says, tuple(term for column in ranked for term in terms_of(column)), before, after if says else before,
                 figures)


def _laws(flights: Flights, rows: Rows, tuning: Tuning) -> tuple[Array, Array]:
    """Coefficients [n, B + K] for each track by the other folds' tracks: believed alone, and with what STLSQ keeps."""
    plain, full = np.zeros((2, len(flights), rows.believed.shape[1] + rows.candidates.shape[1]))
    for held in folds(len(flights)):
        train = rows.take(held.train[rows.track])
        if rows.believed.shape[1]:
            plain[held.out, :rows.believed.shape[1]] = np.linalg.lstsq(train.believed, train.target, rcond=None)[0]
        full[held.out] = np.concatenate(fit(train, tuning))
    return plain, full
