"""Points that a belief is worth on hold-out shots: aimed by it, and let through by its gate.

Aim. A ball misses the height that a belief forecasts for it by some error. Had the motors run at the speed that the
belief asks for from that place with that hood, it would have missed the centre by this very error, as long as the error
does not change between the two speeds. So the error of a hold-out shot's forecast is the miss of the aimed ball, and
the model serves for the difference of two neighbouring set points alone (as in doubly robust off-policy evaluation,
Dudik et al. 2014). An outcome leaves the error open within its class: there it is spread as both beliefs have it, each
a priori as likely.

Gate. It lets the aimed ball through where the belief's P(three) is high enough. A held ball is not lost: it counts what
the threshold says that it is worth, three points times the least probability for which it would be fired. How the gate
judges shots as they were made is reported, and does not count: it would speak for a belief that overrates them.

Every shot is judged by fits to the other folds.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import ndtr, softmax

from truearc.sim.infer.likelihood.data import Intake
from truearc.sim.infer.likelihood.layout import LinearizationPoint, ParameterLayout
from truearc.sim.infer.likelihood.linearization import linearise
from truearc.sim.infer.likelihood.noise import LAPSE
from truearc.sim.infer.likelihood.observations import OutcomeObservations
from truearc.sim.infer.likelihood.score_table import PlaneScores, ScoreTable, folds_of, unseen_change, unseen_score
from truearc.sim.matrices import invert
from truearc.sim.metrics import POINTS_THREE, POINTS_TWO

THRESHOLD = 0.3                       # of P(three), as launcher.toml ships it
FEWEST = 20                           # outcomes by which forecasts are compared with plain shares


class JudgedFit(NamedTuple):
    """A fit with all of its columns shared: the shots as it flies them (with its curves' shares), where it was
    linearised, and its evidence there."""

    intake: Intake
    layout: ParameterLayout
    spot: LinearizationPoint
    evidence: ScoreTable


@dataclass(frozen=True, eq=False)
class HoldOut:
    """Forecasts of the heights of m shots by fits to the other folds, from the settings alone: mean and standard
    deviation [m] in m, from the target's centre as believed."""

    mean_m: Float[np.ndarray, " m"]
    sd_m: Float[np.ndarray, " m"]


@dataclass(frozen=True, eq=False)
class ShotPoints:
    """Of m shots [m], by one belief: expected points of the aimed ball, whether its gate lets it through; whether the
    gate lets the shot through as it was made."""

    aimed: Float[np.ndarray, " m"]
    aimed_fires: Bool[np.ndarray, " m"]
    fires: Bool[np.ndarray, " m"]

    def worth(self, held: float) -> Float[np.ndarray, " m"]:
        """Points [m] of aim and gate together: of the shot aimed, if its gate fires it. held: worth of a ball that is
        kept."""
        return np.where(self.aimed_fires, self.aimed, held)


def hold_out(models: Sequence[JudgedFit], nats: Sequence[float]) -> HoldOut:
    """Forecasts by the average of models, each as likely as the other folds make it (nats: of all shots)."""
    each = [_hold_out(model) for model in models]
    if len(each) == 1:
        return each[0]
    plane = models[0].evidence.plane
    assert plane is not None
    scores = np.stack([unseen_score(model.evidence) for model in models])
    fold = folds_of(scores.shape[1])
    log_weight = np.stack([np.array(nats) - scores[:, fold == held].sum(1) for held in range(fold.max() + 1)])
    weight = softmax(log_weight, axis=1)[fold[plane.rows]].T
    mean = (weight * [one.mean_m for one in each]).sum(0)
    square = (weight * [one.sd_m**2 + one.mean_m**2 for one in each]).sum(0)
    return HoldOut(mean, np.sqrt(np.maximum(square - mean**2, 1e-12)))


def _hold_out(model: JudgedFit) -> HoldOut:
    """By one model, the effects of this session's balls left out: the next ones are others."""
    evidence = model.evidence
    change = unseen_change(evidence)
    group = np.array([column.kind == "group" for column in evidence.columns])
    change[:, group] = -evidence.point[group]
    plane = _from_settings(model)
    _, mean_m, spread_m = plane.moved(evidence.deal.own(change))
    fold, doubt = folds_of(len(evidence.rows)), np.zeros(len(plane.rows))
    for held in range(fold.max() + 1):
        train, mine = fold != held, fold[plane.rows] == held
        doubt[mine] = _doubt(model, plane, evidence.deal.some(train).total(evidence.info[train]))[mine]
    return HoldOut(mean_m, np.sqrt(spread_m**2 + doubt))


def as_believed(model: JudgedFit) -> HoldOut:
    """Forecasts by what was believed before these shots, where the model is linearised; nothing is fitted to them."""
    plane = _from_settings(model)
    return HoldOut(plane.mean_m, np.sqrt(plane.spread_m**2 + _doubt(model, plane, 0.0)))


def _doubt(model: JudgedFit, plane: PlaneScores, known: Float[np.ndarray, "P P"] | float) -> Float[np.ndarray, " m"]:
    """Variances of the means [m], by the columns' prior and the information `known`; of no ball's own effects."""
    evidence = model.evidence
    place = evidence.deal.place[plane.rows]
    group = np.array([column.kind == "group" for column in evidence.columns])
    by = np.where(group[place], 0.0, plane.by_column)
    covariance = invert(evidence.precision + known)
    own = covariance[place[:, :, None], place[:, None, :]]
    return np.asarray(np.maximum(np.einsum("mi,mij,mj->m", by, own, by), 0.0))


def _from_settings(model: JudgedFit) -> PlaneScores:
    """Heights as forecast from the settings: without what a track or a measured exit says of the very shot."""
    intake, plane = model.intake, model.evidence.plane
    assert plane is not None
    if intake.samples is None and not np.isfinite(intake.exits).any():
        return plane
    blind = replace(intake, samples=None, scatter=None, exits=np.full(intake.exits.shape, np.nan))
    still = replace(model.spot, deviates=np.zeros_like(model.spot.deviates))
    plane = linearise(blind, model.layout, still)[0].plane
    assert plane is not None
    return plane


def points_of(seen: OutcomeObservations, mine: HoldOut, both: Sequence[HoldOut], threshold: float) -> ShotPoints:
    """Points by the belief with the forecasts `mine`; both: those of all beliefs that are compared."""
    two, three = float(seen.borders[4]), float(seen.borders[3])
    least = three if three > 0.0 else two                # of a hit-or-miss target a hit counts two
    aimed, off_m = np.zeros(len(mine.mean_m)), np.abs(seen.height_m - mine.mean_m)
    low, high = seen.low, seen.high
    chance = np.stack([_share(low, high, one).sum(1) for one in both]) + 1e-12
    for half, points in ((two, POINTS_TWO), (three, POINTS_THREE - POINTS_TWO)):
        inside_low = np.maximum(low, (mine.mean_m - half)[:, None])
        inside_high = np.minimum(high, (mine.mean_m + half)[:, None])
        inside = np.stack([_share(inside_low, inside_high, one).sum(1) for one in both])
        if half > 0.0:
            aimed += points * np.where(seen.measured, off_m <= half, inside.sum(0) / chance.sum(0))
    at_centre = replace(mine, mean_m=np.zeros_like(mine.mean_m))
    return ShotPoints(np.minimum(aimed, POINTS_THREE), *(_within(least, one) >= threshold for one in (at_centre, mine)))


def shares_beaten(seen: OutcomeObservations, mine: HoldOut) -> float | None:
    """Standard errors by which outcomes' log score by the forecasts is above that by the plain shares of miss, two and
    three; None where fewer than FEWEST outcomes are known without their height, or all are alike."""
    known = np.isfinite(seen.classes) & ~seen.measured
    level, count = np.unique(seen.classes[known], return_counts=True)
    if known.sum() < FEWEST or len(level) < 2:
        return None
    chance = (1.0 - LAPSE) * _share(seen.low, seen.high, mine).sum(1)[known] + LAPSE / 3.0
    plain = count[np.searchsorted(level, seen.classes[known])] / known.sum()
    gain = np.log(chance) - np.log(plain)
    return float(gain.mean() / (gain.std() / math.sqrt(len(gain)) + 1e-12))


def scored_points(seen: OutcomeObservations) -> Float[np.ndarray, " m"]:
    """Points [m] that shots did score; of a measured height those of its class."""
    two, three = seen.borders[4], seen.borders[3]
    off_m = np.abs(seen.height_m)
    level = np.where(np.isfinite(seen.classes), seen.classes, np.where(off_m <= three, 2.0, np.where(off_m <= two, 1.0,
                                                                                                     0.0)))
    return np.asarray(np.choose(level.astype(int), [0.0, POINTS_TWO, POINTS_THREE]))


def _share(low: Float[np.ndarray, "m 2"], high: Float[np.ndarray, "m 2"], one: HoldOut) -> Float[np.ndarray, "m 2"]:
    """Probability [m, 2] of intervals; of one that ends before it begins: 0."""
    with np.errstate(invalid="ignore"):
        share = (ndtr((high - one.mean_m[:, None]) / one.sd_m[:, None])
                 - ndtr((low - one.mean_m[:, None]) / one.sd_m[:, None]))
    return np.where(low < high, np.maximum(np.nan_to_num(share), 0.0), 0.0)


def _within(half_m: float, one: HoldOut) -> Float[np.ndarray, " m"]:
    return np.asarray(ndtr((half_m - one.mean_m) / one.sd_m) - ndtr((-half_m - one.mean_m) / one.sd_m))
