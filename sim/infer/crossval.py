"""How well a fit predicts outcomes that it has not seen: folds of whole configurations, refitted without them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from truearc.sim.data.columns import OUTCOMES
from truearc.sim.infer.likelihood.shot_likelihood import outcome_table
from truearc.sim.infer.map_fit import MapFit, refit
from truearc.sim.progress import Progress

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
    n = len(fit.problem.evidence.given.rolled)
    shots = fit.gathered.shots.take(fit.gathered.rows[:n])
    outcome = np.array([OUTCOMES.index(word) if word else -1 for word in shots.text("outcome")])
    usable = (outcome >= 0) & np.isfinite(shots.number("distance_m"))
    group = _groups(fit, n)
    if fit.model.facts.target is None or len(np.unique(group[:n][usable])) < 2:
        return None
    fold, given_fit, given_share = group % FOLDS, np.full((n, 3), np.nan), np.full((n, 3), np.nan)
    for number in range(FOLDS):
        progress(number / FOLDS, f"fold {number + 1} of {FOLDS}")
        out = (fold[:n] == number) & usable
        if not out.any():
            continue
        found = refit(fit, (fold != number).astype(float))
        table = np.asarray(outcome_table(fit.model, fit.problem.evidence, fit.problem.points, found.u))
        given_fit[out] = table[out]
        counts = np.bincount(outcome[usable & ~out], minlength=3) + SMOOTH
        given_share[out] = counts / counts.sum()
    return _summary(outcome[usable], given_fit[usable], given_share[usable], group[:n][usable])


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


def _groups(fit: MapFit, n: int) -> Int[np.ndarray, " units"]:
    """Number of each unit's group [n + f]: sessions where there are five, else configurations in a mixed order."""
    shots = fit.gathered.shots.take(fit.gathered.rows)
    sessions = np.array(shots.text("session"))
    if len(set(sessions.tolist())) >= FOLDS:
        return np.unique(sessions, return_inverse=True)[1]
    columns = [np.round(np.nan_to_num(shots.number(name), nan=-1.0) / step) for name, step in STEPS.items()]
    number = np.unique(np.column_stack(columns), axis=0, return_inverse=True)[1].ravel()
    return np.random.default_rng(0).permutation(number.max() + 1)[number]
