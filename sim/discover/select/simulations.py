"""The simulations that are candidates for adoption, and the value of their forecasts for hold-out shots.

Choosing one of several likely names discards the information in the others and is often wrong (Hoeting et al. 1999), so
forecasts are averaged over names. An average of forecasts is not a simulation, and numbers averaged over names were
never fitted, but a single simulation can make nearly the same forecasts. An unexplained effect is represented by an
unnamed term that follows the fitted free curve.

The aim is judged as follows. A ball misses its forecast height by some error. At the speed that the belief requires for
that place and hood angle, it would have missed the centre by the same error, provided that the error does not change
between the two speeds. The forecast error of a hold-out shot is therefore the miss of the aimed ball, and the model
provides only the difference between two neighbouring set points (as in doubly robust off-policy evaluation, Dudik et
al. 2014). An outcome does not determine the error within its class; there, the error follows the mixture of the
distributions of the two beliefs that are compared, with equal prior weights.

The gate passes the aimed ball if the belief's P(three) is high enough. A held ball is not lost: it counts as three
points times the threshold, the lowest probability at which it would be fired. The gate's judgement of the shots
actually fired is reported but does not count, since it would favour a belief that overrates them.

Every shot is judged with fits to the folds that do not contain it.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import softmax

from truearc.sim.discover.decide import Search, Step, clearly, judge_left
from truearc.sim.discover.detect.battery import FREE, Test
from truearc.sim.discover.detect.covariates import Covariate, CovariatePair, Factor, spline_knots
from truearc.sim.discover.detect.localization import Correction, correct
from truearc.sim.discover.select.posterior import climb_carried
from truearc.sim.discover.select.terms import SURE, Naming
from truearc.sim.infer.belief import Curve, natural
from truearc.sim.infer.fit import Fit
from truearc.sim.infer.launcher import Launcher, LauncherFit, curve_term, out_of_range
from truearc.sim.infer.likelihood.layout import Layout, Point, is_tracker
from truearc.sim.infer.likelihood.linearization import FAR_BELOW_M, LEAD, TRACK, variance_of
from truearc.sim.infer.likelihood.noise import LAPSE, TIMED_M
from truearc.sim.infer.likelihood.observations import timed_noise, whiten
from truearc.sim.infer.likelihood.outcomes import Outcomes
from truearc.sim.infer.likelihood.score_table import Array, PlaneScores, ScoreTable, folds_of
from truearc.sim.physics.simulate import LAUNCH_STATE
from truearc.sim.statistics import invert

# Chosen: the rest is long enough for forces to show
FORECAST = 0.4                        # of a track's samples: from these its end is forecast


def end_errors(fit: LauncherFit, change: Float[Array, "n P"]) -> float | None:
    """Return the RMS error in m of forecast heights, with columns changed by `change` [n, P]; None if no height was
    measured.

    With tracks: at each one's last sample, the shot's own deviation taken from its first FORECAST of samples. Without:
    heights measured at the plane against those of the scores.
    """
    if fit.model.data.filmed:
        errors = track_errors(fit, change)[:, 2]
    else:
        if fit.scores.plane is None or not fit.scores.plane.seen.measured.any():
            return None
        seen, mean_m, _ = fit.scores.heights(change)
        errors = (mean_m - seen.height_m)[seen.measured]
    return float(np.sqrt(np.mean(errors**2)))


def side_errors(fit: LauncherFit, change: Float[Array, "n P"]) -> float:
    """Return the RMS error in m of y at each track's last sample, forecast as the height is by end_errors."""
    return float(np.sqrt(np.mean(track_errors(fit, change)[:, 1]**2)))


def times_off(fit: LauncherFit) -> float | None:
    """Return the RMS difference of times at heights from the simulation, in their standard deviations; None without
    times."""
    samples, rows = fit.model.data.samples, fit.model.data.tracked
    if samples is None or samples.clock_s is None:
        return None
    flown = fit.model.fly(fit.point)
    speed_m_s = np.asarray(flown.slopes.track_m)[rows, :, 2, len(fit.model.layout.inputs) + LEAD]
    off = (samples.position_m - flown.seen.track_m[rows])[..., 2] / (TIMED_M * timed_noise(samples, speed_m_s))
    return float(np.sqrt(np.mean(off[samples.real]**2)))


def track_errors(fit: LauncherFit, change: Float[Array, "n P"], share: float = FORECAST) -> Float[Array, "k 3"]:
    """Return [k, 3] in m: each track's last sample minus its forecast from the first `share` of its samples; 0: from
    the settings alone."""
    data, point = fit.model.data, fit.point
    samples, rows, scatter = data.samples, data.tracked, data.scatter
    assert samples is not None and scatter is not None
    columns = np.flatnonzero(fit.model.layout.source >= 0)
    flown = fit.model.fly(point)
    seen, slopes = flown.seen, flown.slopes
    by_column, by_deviate = np.split(slopes.track_m[rows], [len(fit.model.layout.inputs)], axis=3)
    by_column = by_column[..., :len(columns)]
    off = (samples.position_m - seen.track_m[rows] - np.einsum("klcp,kp->klc", by_column, change[rows][:, columns])
           + np.einsum("klcd,kd->klc", by_deviate, point.deviates[rows]))
    sd = np.sqrt(variance_of(data, point.log_scatter))[rows][:, :by_deviate.shape[3]]
    white = whiten(samples, scatter, np.concatenate([off[..., None], by_deviate * sd[:, None, None, :]], axis=3))
    white /= np.exp(point.log_scatter[TRACK])
    errors = np.zeros((len(rows), 3))
    for k, count in enumerate(samples.real.sum(1)):
        early = white[k, :3 * max(int(share * count), 4 if share else 0)]
        slope = early[:, 1:]
        told = np.linalg.solve(np.eye(slope.shape[1]) + slope.T @ slope, slope.T @ early[:, 0])
        errors[k] = off[k, count - 1] - by_deviate[k, count - 1] @ (sd[k] * told)
    return errors


THRESHOLD = 0.3                       # of P(three), as launcher.toml ships it; source: gate.threshold there
# Chosen: seven of each class
FEWEST = 20                           # outcomes by which forecasts are compared with plain shares


@dataclass(frozen=True, eq=False)
class HoldOut:
    """Forecasts of the heights of m shots by fits to the other folds, from the settings alone: mean and standard
    deviation [m] in m, from the believed target's centre."""

    mean_m: Float[np.ndarray, " m"]
    sd_m: Float[np.ndarray, " m"]


@dataclass(frozen=True, eq=False)
class ShotPoints:
    """Points of m shots [m], under one belief: expected points of the aimed ball, whether its gate passes it, and
    whether the gate passes the shot as made."""

    aimed: Float[np.ndarray, " m"]
    aimed_fires: Bool[np.ndarray, " m"]
    fires: Bool[np.ndarray, " m"]

    def worth(self, held: float) -> Float[np.ndarray, " m"]:
        """Return points [m] of aim and gate together: of the aimed shot if its gate passes it, else `held`, the value
        of a kept ball."""
        return np.where(self.aimed_fires, self.aimed, held)


def hold_out(models: Sequence[LauncherFit], nats: Sequence[float]) -> HoldOut:
    """Forecasts by the average of fits of shared columns, each as likely as the other folds make it (nats: of all).
    """
    each = [_hold_out(model) for model in models]
    if len(each) == 1:
        return each[0]
    plane = models[0].scores.plane
    assert plane is not None
    scores = np.stack([model.scores.held_out() for model in models])
    fold = folds_of(scores.shape[1])
    log_weight = np.stack([np.array(nats) - scores[:, fold == held].sum(1) for held in range(fold.max() + 1)])
    weight = softmax(log_weight, axis=1)[fold[plane.rows]].T
    mean = (weight * [one.mean_m for one in each]).sum(0)
    square = (weight * [one.sd_m**2 + one.mean_m**2 for one in each]).sum(0)
    return HoldOut(mean, np.sqrt(np.maximum(square - mean**2, 1e-12)))


def _hold_out(model: LauncherFit) -> HoldOut:
    """By one model, the effects of this session's balls left out: the next ones are others."""
    evidence = model.scores
    change = evidence.held_out_change()
    group = np.array([column.kind == "group" for column in evidence.columns])
    change[:, group] = -evidence.point[group]
    plane = _from_settings(model)
    _, mean_m, spread_m = plane.moved(evidence.deal.own(change))
    fold, doubt = folds_of(len(evidence.rows)), np.zeros(len(plane.rows))
    for held in range(fold.max() + 1):
        train, mine = fold != held, fold[plane.rows] == held
        doubt[mine] = _doubt(model, plane, evidence.deal.some(train).total(evidence.info[train]))[mine]
    return HoldOut(mean_m, np.sqrt(spread_m**2 + doubt))


def as_believed(model: LauncherFit) -> HoldOut:
    """Return forecasts by the belief before these shots, at the model's linearization point; nothing is fitted to
    them."""
    plane = _from_settings(model)
    return HoldOut(plane.mean_m, np.sqrt(plane.spread_m**2 + _doubt(model, plane, 0.0)))


def _doubt(model: LauncherFit, plane: PlaneScores, known: Float[np.ndarray, "P P"] | float) -> Float[np.ndarray, " m"]:
    """Variances of the means [m], by the columns' prior and the information `known`; of no ball's own effects."""
    evidence = model.scores
    place = evidence.deal.place[plane.rows]
    group = np.array([column.kind == "group" for column in evidence.columns])
    by = np.where(group[place], 0.0, plane.by_column)
    own = invert(evidence.precision + known)[place[:, :, None], place[:, None, :]]
    return np.asarray(np.maximum(np.einsum("mi,mij,mj->m", by, own, by), 0.0))


def _from_settings(model: LauncherFit) -> PlaneScores:
    """Heights as forecast from the settings: without what a track or a measured exit says of the very shot."""
    data, plane = model.model.data, model.scores.plane
    if data.samples is not None or np.isfinite(data.exits).any():
        plane = model.model.forecast(model.point).plane
    assert plane is not None
    return plane


def points_of(seen: Outcomes, mine: HoldOut, both: Sequence[HoldOut], threshold: float) -> ShotPoints:
    """Return points under the belief with the forecasts `mine`; both: forecasts of all compared beliefs."""
    aimed = seen.points_if_aimed(mine.mean_m, [(one.mean_m, one.sd_m) for one in both])
    return ShotPoints(aimed, *(seen.hit_chance(mean_m, mine.sd_m) >= threshold
                               for mean_m in (seen.centred(mine.mean_m), mine.mean_m)))


def shares_beaten(seen: Outcomes, mine: HoldOut) -> float | None:
    """Return by how many standard errors the forecasts' log score of outcomes exceeds that of the observed proportions
    of miss, two and three; None if fewer than FEWEST outcomes are known without their height, or all are equal."""
    known = np.isfinite(seen.classes) & ~seen.measured
    level, count = np.unique(seen.classes[known], return_counts=True)
    if known.sum() < FEWEST or len(level) < 2:
        return None
    chance = (1.0 - LAPSE) * seen.share(mine.mean_m, mine.sd_m)[known] + LAPSE / 3.0
    gain = np.log(chance) - np.log(count[np.searchsorted(level, seen.classes[known])] / known.sum())
    return float(gain.mean() / (gain.std() / math.sqrt(len(gain)) + 1e-12))


# Chosen: moves the average by less than 2 % of an effect
LEAST_SHARE = 0.02                          # share of the probability below which a name has no part
AVERAGE_STEPS = 8
ENOUGH = 1e-3                         # of what is left between both, that a step must take away
# Chosen: a tenth of the prior, so that heights decide wherever they tell names apart
FAITH = 0.1                           # weight of the prior about the averaged numbers: it decides between names alike


@dataclass(frozen=True)
class Mixed:
    """share: {column: probability} of the names that have a part, likeliest first; the rest is nothing's, or too
    little. fitted: all of them and all shared columns at once, where they forecast the average."""

    share: dict[str, float]
    fitted: LauncherFit


def mixed(step: Step) -> Mixed | None:
    """Return the average; None if one name stands alone, or no heights are forecast."""
    naming = step.naming
    if naming.probability[naming.leader] >= SURE or step.fitted.scores.plane is None:
        return None
    share = shares(naming)
    model = step.fitted.model.shared_only(share)
    start, wanted = _average(step, model.layout, share)
    point = model.moved(step.fitted.point, start - _point(step.fitted.scores, model.layout))
    return None if wanted is None else Mixed(share, _come_near(model, point, start, wanted))


def shares(naming: Naming) -> dict[str, float]:
    """Probability of each name that was refitted, where no effect is a priori as likely as all names together; those
    with a part, likeliest first."""
    nats = {name: naming.nats[name] for name in naming.refits}
    nothing = np.log(sum(candidate.visible for candidate in naming.candidates))
    top = max(nothing, *nats.values())
    whole = np.exp(nothing - top) + sum(np.exp(value - top) for value in nats.values())
    share = {name: float(np.exp(value - top) / whole) for name, value in nats.items()}
    return {name: value for name, value in sorted(share.items(), key=lambda item: -item[1]) if value >= LEAST_SHARE}


def _average(step: Step, layout: Layout,
             share: dict[str, float]) -> tuple[Float[Array, " P"], PlaneScores | None]:
    """(all numbers [P], each name's as far as it is likely; the average forecast, if there is one)."""
    point = (1.0 - sum(share.values())) * _point(step.fitted.scores, layout)
    null = step.fitted.scores.plane
    assert null is not None
    mean, flown = (1.0 - sum(share.values())) * null.mean_m, null.mean_m > FAR_BELOW_M
    for name, value in share.items():
        evidence = step.naming.refits[name].scores
        point = point + value * _point(evidence, layout)
        if evidence.plane is None or not np.array_equal(evidence.plane.rows, null.rows):
            return point, None
        mean, flown = mean + value * evidence.plane.mean_m, flown & (evidence.plane.mean_m > FAR_BELOW_M)
    return point, replace(null, mean_m=np.where(flown, mean, np.nan))


def _point(evidence: ScoreTable, layout: Layout) -> Float[Array, " P"]:
    """The layout's numbers [P] as that evidence has them; zero for a name that it has not put in."""
    shared = zip(evidence.columns[evidence.first_shared:], evidence.point[evidence.first_shared:], strict=True)
    known = {column.name: float(value) for column, value in shared}
    return np.array([known.get(column.name, 0.0) for column in layout.columns])


def _come_near(model: Launcher, point: Point, start: Float[Array, " P"], wanted: PlaneScores) -> LauncherFit:
    """Gauss-Newton steps of all numbers except scatters and random effects of balls, as long as they reduce the rest.
    """
    free = np.flatnonzero(model.layout.source >= 0)
    prior = FAITH * model.layout.precision[np.ix_(free, free)]
    evidence = model.linearise(point)[0]
    slope, gap, off = _left(evidence, wanted, free, start)
    left = gap @ gap + off @ prior @ off
    for _ in range(AVERAGE_STEPS):
        change = np.zeros(len(model.layout.columns))
        change[free] = np.linalg.lstsq(slope.T @ slope + prior, slope.T @ gap + prior @ off, rcond=None)[0]
        there = model.moved(point, change)
        tried = model.linearise(there)[0]
        slope, gap, off = _left(tried, wanted, free, start)
        now = gap @ gap + off @ prior @ off
        if not now < (1.0 - ENOUGH) * left:
            break
        point, evidence, left = there, tried, now
    return Fit(model, point, evidence)


def _left(evidence: ScoreTable, wanted: PlaneScores, free: Int[Array, " free"], start: Float[Array, " P"]) -> tuple[
        Float[Array, "m free"], Float[Array, " m"], Float[Array, " free"]]:
    """(slopes [m, free] and what is missing [m] of the heights that are wanted, in the launch's own scatter; how far
    the numbers are from the averaged ones [free])."""
    plane = evidence.plane
    assert plane is not None
    kept = np.isfinite(wanted.mean_m) & (plane.mean_m > FAR_BELOW_M)
    missing = (wanted.mean_m - plane.mean_m)[kept] / wanted.spread_m[kept]
    return plane.by_column[kept][:, free] / wanted.spread_m[kept, None], missing, (start - evidence.point)[free]


MOST_CURVES = 3                       # curves; bounds the work
BEFORE = frozenset(("distance_m", "hood_deg", "motor_ratio", *LAUNCH_STATE))
UNABLE = "no simulation of single shots can hold the unexplained effect"
APART = ("scatter.", "curve.")        # columns that are not coefficients, beside those of a tracker's errors


@dataclass(frozen=True)
class Freed:
    """`term` with `values` holds the curve; fitted: with its points among the shared columns; evidence: these and the
    other shared ones alone; `said` in short. beside: the step's name that was put in before it, if any."""

    term: str
    values: dict[str, float]
    curve: Curve
    fitted: LauncherFit
    scores: ScoreTable
    said: str
    beside: str = ""


def all_freed(step: Step, search: Search) -> tuple[tuple[Freed, ...], str]:
    """(curves of the unexplained step, then of the misfit beside them, each clearly better on unseen shots; why one was
    left out, if it was).

    Left out: beside which a coefficient comes to the end of what is possible; which explains nothing once it is flown;
    an effect that no simulation of single shots can hold (two covariates together; a launch to one side, on which no
    height depends); a second curve of the same thing.
    """
    fitted, correction = _likeliest(step)
    if correction is None:
        return (), ""
    found: list[Freed] = []
    while correction is not None and len(found) < MOST_CURVES:
        foreseeable = _foreseeable(fitted, correction, search)
        others = () if foreseeable is correction else (correction,)
        one, why = _first_possible(fitted, (foreseeable, *others))
        if one is None:
            return tuple(found), "" if found and why == UNABLE else why
        found.append(one if found or step.change is None else replace(one, beside="".join(step.change.names)))
        fitted = one.fitted
        correction = _what_is_left(fitted, search)
    return tuple(found), ""


def _likeliest(step: Step) -> tuple[LauncherFit, Correction | None]:
    """(the fit, with the name beside which the likeliest change stands; that change, else the one that was found)."""
    change, fitted = step.change, step.fitted
    if change is None or change.family is None:
        return fitted, None if step.place is None else step.place.correction
    if change.names:
        fitted = fitted.beside(step.naming.refits[change.names[0]])
    column = fitted.scores.index(change.family.column)
    return fitted, correct(fitted.scores, Test(FREE, column, change.family.what, "smooth",
                                                 np.ones(len(fitted.scores.rows))))


def _first_possible(fitted: LauncherFit, corrections: tuple[Correction, ...]) -> tuple[Freed | None, str]:
    """(the first of them that may be believed, why the last one may not)."""
    why = ""
    for correction in corrections:
        one = freed(fitted, correction)
        if one is None:
            why = UNABLE
        elif beyond := _impossible(one):
            why = f"beside the free curve {', '.join(beyond)} would be impossible"
        elif one.scores.log_score.sum() <= fitted.scores.log_score.sum():
            why = "the free curve explains nothing once it is flown"
        else:
            return one, ""
    return None, why


def _foreseeable(fitted: LauncherFit, correction: Correction, search: Search) -> Correction:
    """The same change over what is known before a shot, if that gains half as much on unseen shots: a curve over what
    the shot itself did to the wheels counts with its mean in every forecast."""
    what = correction.test.what
    if not isinstance(what, Covariate):
        return correction
    if BEFORE & set(what.names):
        return replace(correction, test=replace(correction.test, what=what.led_by(BEFORE)))
    asked = search.ask(fitted)
    gain = judge_left(asked, search.seed).gain
    others = [k for k, test in enumerate(asked.tests) if test.column == correction.test.column
              and isinstance(test.what, Covariate) and BEFORE & set(test.what.names)]
    if not others:
        return correction
    test = asked.tests[max(others, key=lambda k: gain[k])]
    assert isinstance(test.what, Covariate)
    other = correct(fitted.scores, replace(test, what=test.what.led_by(BEFORE)))
    return other if other.gain.sum() >= 0.5 * correction.gain.sum() else correction


def freed(fitted: LauncherFit, correction: Correction) -> Freed | None:
    """Return the curve; None for what cannot be adopted."""
    column = fitted.scores.columns[correction.test.column]
    taken, curve = curve_term(column, fitted.model.layout), _curve(correction)
    if taken is None or curve is None:
        return None
    curve, whole, evidence = _fly(fitted, correction, *taken, curve)
    goes = f" by {curve.covariate}" if curve.covariate else ""
    return Freed(*taken, curve, whole, evidence, f"{column.name}{goes}")


def _impossible(free: Freed) -> list[str]:
    values = zip(free.scores.columns, map(float, free.scores.point), strict=True)
    among = free.fitted.model.catalogue
    return out_of_range({column.name: value for column, value in values if column.kind == "shared"
                         and not column.name.startswith(APART) and not is_tracker(column, among)}, among)


def _what_is_left(fitted: LauncherFit, search: Search) -> Correction | None:
    """The free change that explains most of what is left beyond chance, of those that a curve can take."""
    left = search.left(fitted)
    if left is None:
        return None
    asked, judged = left
    able = np.array([k for k, test in enumerate(asked.tests) if test.family == FREE and curve_term(
        fitted.scores.columns[test.column], fitted.model.layout) is not None], dtype=int)
    if not len(able):
        return None
    # not the plainest: what it leaves would be found again
    correction = correct(fitted.scores, asked.tests[able[judged.gain[able].argmax()]])
    return correction if clearly(correction.gain, fitted) else None


def _fly(fitted: LauncherFit, correction: Correction, term: str, values: dict[str, float],
         curve: Curve) -> tuple[Curve, LauncherFit, ScoreTable]:
    """(the curve, all, shared evidence) where the simulation that has both fits best."""
    by = curve.by(_columns(correction), len(fitted.model.data.rows))
    carried = fitted.model.along_zero(fitted.point, fitted.lost, term, values, curve, by)
    model, top = carried.model, climb_carried(carried)
    found = curve.moved({key: float(top.scores.point[k]) for k, key in enumerate(curve.fitted)})
    if curve.covariate:
        found = found.moved({curve.keys[-1]: float(by.mean(0) @ found.points)})
    return found, Fit(model, top.point, model.linearise(top.point)[0]), top.scores


def _columns(correction: Correction) -> dict[str, Any]:
    """The covariate of each of the evidence's shots, by name."""
    what, rows = correction.test.what, correction.scores.rows
    if isinstance(what, Covariate):
        return {what.name: what.values[rows]}
    return {what.name: [what.levels[code] if code >= 0 else "" for code in what.codes[rows]]} if isinstance(
        what, Factor) else {}


def _curve(correction: Correction) -> Curve | None:
    what, amplitude = correction.test.what, correction.amplitude
    rows, otherwise = correction.scores.rows, float(correction.amplitude.mean())
    if what is None:
        return Curve((), otherwise)
    if isinstance(what, Factor):
        codes = what.codes[rows]
        seen = [k for k in range(len(what.levels)) if (codes == k).any()]
        return Curve(tuple(float(amplitude[codes == k][0]) for k in seen), otherwise, what.name,
                     levels=tuple(what.levels[k] for k in seen))
    if isinstance(what, CovariatePair) or not isinstance(what, Covariate):
        return None
    # values at the fit's own knots: between them the fit is that very spline
    x = what.values[rows]
    said = np.isfinite(x)
    knots = spline_knots(x[said])
    value = np.linalg.lstsq(natural(knots, x[said]), amplitude[said], rcond=None)[0]
    return Curve(tuple(map(float, value)), otherwise, what.name, at=tuple(map(float, knots)),
                 low=float(x[said].min()), high=float(x[said].max()))
