"""The text report of a fit: its numbers, which of them are aliased, and how well the fit predicts outcomes."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Float, Int

from truearc.sim.infer.forecast import forecast
from truearc.sim.infer.intervals import KNOWN, NumberChange, ProfileInterval, tracker_errors
from truearc.sim.infer.landing_forecast import forecast_landings
from truearc.sim.infer.launcher import MapFit, Sought, odd_places
from truearc.sim.infer.likelihood.data import FEWEST_SHOTS, say_few
from truearc.sim.infer.likelihood.noise import UNMEASURED_M
from truearc.sim.infer.likelihood.score_table import FOLDS, fit_linear
from truearc.sim.physics.catalogue import Catalogue
from truearc.sim.printed import Progress, left_out_lines
from truearc.sim.statistics import Z90

# Chosen: only a fifth of either's variance is left by the other
CORRELATED = 0.9                      # pairs from here on are named


# Chosen: below what sensors tell apart
STEPS = {"distance_m": 0.1, "hood_deg": 1.0, "motor_ratio": 0.01}      # shots within one step are one configuration
# Source: Laplace's rule of succession (1814)
SMOOTH = 1.0                          # shots of each outcome added to the shares that the fit competes with


@dataclass(frozen=True)
class CrossValidation:
    """Means over shots with an outcome: log score (natural logarithm of the probability given to the outcome) and
    accuracy, of the fit and of the observed proportions of outcomes; gain_se is of their paired difference, by
    groups."""

    shots: int
    groups: int
    log_score: float
    share_log_score: float
    gain_se: float
    accuracy: float
    share_accuracy: float


def cross_validate(fit: MapFit, progress: Progress = lambda done, note: None) -> CrossValidation | None:
    """Cross-validate with five folds of whole groups; None if fewer than two groups have an outcome.

    Groups are sessions if there are at least five, else configurations. Predictions use the configuration alone:
    neither the exit nor the track of a predicted shot is used.
    """
    plane = fit.scores.plane
    if plane is None or fit.dataset.facts.target is None:
        return None
    group, marked = _groups(fit), plane.rows
    outcome = np.nan_to_num(plane.seen.classes, nan=-1.0).astype(int)
    if len(np.unique(group[marked][outcome >= 0])) < 2:
        return None
    fold, alone = group % FOLDS, fit.fitted.model.forecast(fit.fitted.point)
    given_fit, given_share = np.full((2, len(marked), 3), np.nan)
    for number in range(FOLDS):
        progress(number / FOLDS, f"fold {number + 1} of {FOLDS}")
        out = (fold[marked] == number) & (outcome >= 0)
        if not out.any():
            continue
        change = fit_linear(fit.scores, fold != number)
        seen, mean_m, spread_m = alone.heights(np.tile(change, (len(fold), 1)))
        given_fit[out] = seen.class_chances(mean_m, spread_m)[out]
        counts = np.bincount(outcome[(outcome >= 0) & ~out], minlength=3) + SMOOTH
        given_share[out] = counts / counts.sum()
    known = outcome >= 0
    return _summary(outcome[known], given_fit[known], given_share[known], group[marked][known])


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
    shots = fit.dataset.shots.take(fit.scores.rows)
    sessions = np.array(shots.text("session"))
    if len(set(sessions.tolist())) >= FOLDS:
        return np.unique(sessions, return_inverse=True)[1]
    columns = [np.round(np.nan_to_num(shots.number(name), nan=-1.0) / step) for name, step in STEPS.items()]
    number = np.unique(np.column_stack(columns), axis=0, return_inverse=True)[1].ravel()
    return np.random.default_rng(0).permutation(number.max() + 1)[number]


EVIDENCE = {"outcome": "outcomes", "side": "sides (high or low)", "miss_height_m": "measured heights",
            "exit_speed_m_s": "measured exit speeds", "exit_deg": "measured exit angles",
            "exit_spin_rev_s": "measured spins", "tracks": "tracks", "times": "times at heights"}
# Chosen: their noise is known to a tenth or better
MISFIT = 1.3                          # times their noise that tracks differ from a fit that lacks something
NEAREST = 15                          # shots whose median stands for "at this distance"; chosen: a printed figure


def fit_lines(fit: MapFit, intervals: Sequence[ProfileInterval], holdout: CrossValidation | None) -> list[str]:
    """Return the report, line by line; for a fit that did not converge, only what was used."""
    lines = list(say_evidence(fit))
    if not fit.converged:
        return lines
    odd = odd_places(fit.scores, fit.catalogue)
    for title, part in (("what these shots can tell", say_identified(fit)),
                        ("estimates", say_estimates(intervals, fit.sought, odd)), ("", say_scatter(fit)),
                        ("", say_prediction(holdout))):
        told = list(part)
        lines += [*(["", f"{title}:"] if title and told else []), *told]
    return lines


def say_evidence(fit: MapFit) -> Iterable[str]:
    """Report the evidence used, and excluded shots."""
    intake = fit.fitted.model.data
    used = ", ".join(f"{count} {EVIDENCE[kind]}" for kind, count in intake.used.items())
    yield f"fitted to {len(intake.rows)} of {len(fit.dataset.shots)} shots: {used}"
    wider = dict(zip((one.name for one in fit.scores.columns), fit.scores.point, strict=True)).get("scatter.track")
    if intake.scatter is not None and wider is not None:
        own_m = dict(zip("xyz", intake.scatter.sigma_m, strict=True))
        noise = ", ".join(f"{axis} {1000.0 * size:.2g}" for axis, size in own_m.items() if size < UNMEASURED_M)
        yield (f"tracks differ from this fit by {np.exp(wider):.2g} times their own noise ({noise} mm, as the tracks "
               "show it)" + ("; something is missing: truearc discover looks for it" if np.exp(wider) > MISFIT else ""))
    yield from left_out_lines(intake.left_out)
    if len(intake.rows) < FEWEST_SHOTS:
        yield f"warning: {say_few(len(intake.rows))}; the estimates below are mostly those believed before"
    for name, value in fit.at_limit.items():
        yield (f"warning: {name} stopped at the end of its range, {number_text(value)}: these terms do not explain the "
               "shots; truearc discover looks for one that does")


def say_tracker_errors(errors: Iterable[Sequence[NumberChange]], among: Catalogue) -> list[str]:
    """A sentence on each set of errors of the tracker that is known, with 90 % intervals, without a full stop."""
    return [f"the tracker is off: {', or '.join(_error_text(one, among) for one in found)}"
            + (", or a part of each: measure one" if len(found) > 1 else "; measure it") for found in errors]


def _error_text(one: NumberChange, among: Catalogue) -> str:
    phrase = among.find([one.name.partition(".")[0]])[0].phrase
    size, half = abs(one.change) * phrase.factor, Z90 * one.sd * phrase.factor
    places = max(-math.floor(math.log10(half)), 0)
    return (phrase.less if one.change < 0.0 else phrase.more).format(
        f"{size:.{places}f} (± {half:.{places}f}){phrase.unit}")


def say_estimates(intervals: Sequence[ProfileInterval], sought: Iterable[Sought],
                  odd: Mapping[str, str]) -> Iterable[str]:
    """Return a line per parameter: value, 90 % interval, unit, meaning, and what besides the data bounded the interval;
    then the remarks on numbers at odd places."""
    yield "parameter                  value    90 % interval         meaning"
    fitted = {one.name: one for one in sought}
    for one in intervals:
        what = fitted[one.name]
        factor, unit = (100.0, "%") if what.percent else (1.0, "" if what.unit == "1" else what.unit)
        numbers = [number_text(factor * part) for part in (one.value, one.low90, one.high90)]
        line = f"{one.name:24s} {numbers[0]:>8s}    {numbers[1]} to {numbers[2]} {unit}"
        yield f"{line:57s}  {what.meaning}{_open_ends(one)}"
    if "drag.cd" in fitted:
        yield ("the ball's mass and radius and the air's density are taken as stated: 1 % of mass or density is 1 % of "
               "drag.cd, 1 % of radius 2 %")
    yield from (f"warning: {remark}" for remark in odd.values())
    for one in intervals:
        if one.name not in odd and fitted[one.name].improbable(one.value):
            yield (f"warning: {one.name} {number_text(one.value)} was believed all but impossible before: it may stand "
                   "for an effect that these terms lack; truearc discover says whether these shots show one")


def number_text(value: float) -> str:
    """Format a number with three digits."""
    return f"{value:.3g}" if abs(value) < 1000.0 else f"{value:.0f}"


def _open_ends(one: ProfileInterval) -> str:
    if not one.closed:
        return "; OPEN: the data do not bound it, the end is where the search stopped"
    sides = [word for word, known in (("low", one.low_by_data), ("high", one.high_by_data)) if not known]
    return f"; {' and '.join(sides)} end set by the prior, not by these shots" if sides else ""


def say_scatter(fit: MapFit) -> Iterable[str]:
    """Report the scatter of the height at the target, or of where balls come down."""
    shots = fit.dataset.shots.take(fit.scores.rows)
    shots = shots.take(np.isfinite(shots.number("distance_m")) & fit.fitted.model.data.lanes.rolled)
    if not len(shots):
        return
    middle_m = float(np.median(shots.number("distance_m")))
    nearest = np.argsort(np.abs(shots.number("distance_m") - middle_m), kind="stable")[:NEAREST]
    rig = fit.dataset.facts
    if rig.target is not None and rig.target.faces_up:
        spread_m = forecast_landings(rig, fit.belief, shots.take(nearest)).spread_m
        yield (f"where a ball comes down at {middle_m:.1f} m varies by {100.0 * np.median(spread_m):.0f} cm along (one "
               "standard deviation), with what the sensors misjudge and the uncertainty of this fit")
        return
    ahead = forecast(rig, fit.belief, shots.take(nearest))
    launch, sensor, unknown = (100.0 * float(np.nanmedian(part)) for part in (ahead.launch_m, ahead.sensor_m,
                                                                            ahead.parameter_m))
    yield (f"from shot to shot the height at {middle_m:.1f} m varies by {launch:.0f} cm (one standard deviation); what "
           f"the sensors misjudge adds {sensor:.0f} cm, the uncertainty of this fit {unknown:.0f} cm")


def say_identified(fit: MapFit) -> Iterable[str]:
    """Report what these shots cannot separate, or cannot determine alone."""
    names, share = fit.names, dict(zip(fit.names, np.sqrt(np.diag(fit.covariance)), strict=True))
    own = np.array([one.sd * one.slope(float(fit.scores.point[one.column])) for one in fit.sought])     # units
    covariance = fit.covariance * np.outer(own, own)
    alike = covariance / np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    pairs = [pair for pair in combinations(range(len(names)), 2) if abs(alike[pair]) >= CORRELATED]
    silent = [name for name in names if share[name] > KNOWN]
    for a, b in sorted(pairs, key=lambda pair: -abs(alike[pair])):
        factor = -covariance[a, b] / covariance[b, b]
        known_to = np.sqrt(max(covariance[a, a] + factor * covariance[a, b], 0.0))
        both = f"{names[a]} {'+' if factor >= 0.0 else '-'} {number_text(abs(factor))} {names[b]}"
        at = fit.values[names[a]] + factor * fit.values[names[b]]
        yield (f"{names[a]} and {names[b]} are hard to tell apart: correlation {alike[a, b]:.2f}; this dataset fixes "
               f"{both} at {number_text(at)}, to {number_text(known_to)}")
    for name in silent:
        yield (f"{name}: these shots say hardly more than was believed before ({share[name]:.0%} of the prior's "
               "standard deviation is left)")
    for line in say_tracker_errors(tracker_errors(fit.scores, fit.catalogue), fit.catalogue):
        yield f"warning: {line}; or an effect that these terms lack looks like that"
    if not pairs and not silent:
        yield "every parameter is fixed by these shots on its own"


def say_prediction(score: CrossValidation | None) -> Iterable[str]:
    """Report how well hold-out outcomes are predicted."""
    if score is None:
        return
    gain = score.log_score - score.share_log_score
    yield (f"outcomes of shots held out ({score.shots} in {score.groups} groups): predicted right "
           f"{score.accuracy:.0%} (always naming the commonest: {score.share_accuracy:.0%}); log score "
           f"{score.log_score:.3f} per shot (by plain shares: {score.share_log_score:.3f}), gain {gain:.3f} "
           f"± {score.gain_se:.3f}")
    if gain <= 0.0:
        yield ("warning: on shots held out this fit says no more than the plain shares of outcomes; before using it "
               "make sure of the heights, gears and free speed in rig.toml, and of the outcomes")
