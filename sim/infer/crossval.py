"""How well a fit predicts outcomes that it has not seen: folds of whole configurations, refitted without them."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from truearc.sim.infer.held_out import fit_linear
from truearc.sim.infer.likelihood.linearization import LinearizationPoint, linearise
from truearc.sim.infer.likelihood.outcome_likelihood import class_chances
from truearc.sim.infer.likelihood.score_table import ScoreTable
from truearc.sim.infer.map_fit import MapFit
from truearc.sim.printed import Progress

FOLDS = 5
STEPS = {"distance_m": 0.1, "hood_deg": 1.0, "motor_ratio": 0.01}      # shots within one step are one configuration
SMOOTH = 1.0                          # shots of each outcome added to the shares that the fit competes with


@dataclass(frozen=True)
class CrossValidation:
    """Means over shots with an outcome: log score (natural logarithm of the probability given to what happened) and
    accuracy, by the fit and by the plain shares of outcomes; gain_se is of their paired difference, by groups."""

    shots: int
    groups: int
    log_score: float
    share_log_score: float
    gain_se: float
    accuracy: float
    share_accuracy: float


def cross_validate(fit: MapFit, progress: Progress = lambda done, note: None) -> CrossValidation | None:
    """Five folds of whole groups; None where fewer than two groups have an outcome.

    A group is a session where there are at least five, else a configuration. Predictions are from the configuration
    alone: neither the exit nor the track of a predicted shot is used.
    """
    plane = fit.evidence.plane
    if plane is None or fit.dataset.facts.target is None:
        return None
    group, marked = _groups(fit), plane.rows
    outcome = np.nan_to_num(plane.seen.classes, nan=-1.0).astype(int)
    if len(np.unique(group[marked][outcome >= 0])) < 2:
        return None
    fold, alone = group % FOLDS, _by_configuration(fit)
    given_fit, given_share = np.full((2, len(marked), 3), np.nan)
    for number in range(FOLDS):
        progress(number / FOLDS, f"fold {number + 1} of {FOLDS}")
        out = (fold[marked] == number) & (outcome >= 0)
        if not out.any():
            continue
        change = fit_linear(fit.evidence, fold != number)
        given_fit[out] = class_chances(*alone.heights(np.tile(change, (len(fold), 1))))[out]
        counts = np.bincount(outcome[(outcome >= 0) & ~out], minlength=3) + SMOOTH
        given_share[out] = counts / counts.sum()
    known = outcome >= 0
    return _summary(outcome[known], given_fit[known], given_share[known], group[marked][known])


def _by_configuration(fit: MapFit) -> ScoreTable:
    """The evidence at the fit had neither exits nor tracks been measured, nor anything of single shots."""
    intake, layout, spot = fit.fitted.intake, fit.fitted.layout, fit.fitted.spot
    blind = replace(intake, exits=np.full_like(intake.exits, np.nan), samples=None, scatter=None)
    still = LinearizationPoint.still(layout, len(intake.rows), spot.values, spot.log_scatter)
    return linearise(blind, layout, replace(still, effects=spot.effects))[0]


def _summary(outcome: Int[np.ndarray, " n"], by_fit: Float[np.ndarray, "n 3"], by_share: Float[np.ndarray, "n 3"],
             group: Int[np.ndarray, " n"]) -> CrossValidation:
    rows = np.arange(len(outcome))
    scores = np.log(by_fit[rows, outcome]), np.log(by_share[rows, outcome])
    gain = scores[0] - scores[1]
    names = np.unique(group)
    sums = np.array([(gain - gain.mean())[group == name].sum() for name in names])
    return CrossValidation(len(outcome), len(names), float(scores[0].mean()), float(scores[1].mean()),
                           float(np.sqrt((sums**2).sum()) / len(outcome)),
                           float((by_fit.argmax(1) == outcome).mean()), float((by_share.argmax(1) == outcome).mean()))


def _groups(fit: MapFit) -> Int[np.ndarray, " n"]:
    """Number of each shot's group: sessions where there are five, else configurations in a mixed order."""
    shots = fit.dataset.shots.take(fit.evidence.rows)
    sessions = np.array(shots.text("session"))
    if len(set(sessions.tolist())) >= FOLDS:
        return np.unique(sessions, return_inverse=True)[1]
    columns = [np.round(np.nan_to_num(shots.number(name), nan=-1.0) / step) for name, step in STEPS.items()]
    number = np.unique(np.column_stack(columns), axis=0, return_inverse=True)[1].ravel()
    return np.random.default_rng(0).permutation(number.max() + 1)[number]
