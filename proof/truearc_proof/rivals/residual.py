"""Learners of the residual (Kennedy & O'Hagan's discrepancy): the track's end less the believed forecast of it.

A shot's residual are three coordinates of its track's last sample less the forecast by the believed physics, fitted to
the other folds, from the first 40 % of its samples. Covariates: every column that truearc itself asks about
(configuration, launch state, circumstances, telemetry). Such a learner has no terms to name. It names what it can in
honesty: where the covariate that it leans on most is one that terms of the catalogue follow from shot to shot (the
air's density, the ball's age, the battery, ...), those terms, flight first, since the first samples determine the
launch; on distance, elevation, speed or spin a dozen terms depend, and it names nothing.
"""

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from truearc.sim.data.dataset import Dataset
from truearc.sim.discover.detect.covariates import FOLLOWED, Covariate, gather_covariates
from truearc.sim.discover.select.simulations import track_errors
from truearc.sim.infer.likelihood.layout import only_shared
from truearc.sim.infer.likelihood.score_table import unseen_change, without
from truearc.sim.physics.catalogue import TERMS
from truearc_proof.rivals.claim import Array, Claim, RivalBelief, folds, rms


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
    table = table_of(covariates, believed.fitted.intake.rows[believed.fitted.intake.tracked])
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
    fitted = believed.fitted
    null = without(fitted.evidence)
    errors = track_errors(fitted.intake, only_shared(fitted.layout), fitted.spot, unseen_change(null))
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
