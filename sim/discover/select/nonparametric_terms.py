"""Unexplained effects as part of the simulation: their free curves, and the nonparametric terms that hold them."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from truearc.sim.discover.detect.covariates import Covariate, CovariatePair, Factor, spline_knots
from truearc.sim.discover.detect.free_curve import Correction, correct
from truearc.sim.discover.detect.test_battery import FREE, Test
from truearc.sim.discover.select.flown_curves import climb_with, term_of
from truearc.sim.discover.select.name_effects import Search, Step, clearly, judge_left
from truearc.sim.discover.select.refit import promote
from truearc.sim.infer.belief import Curve, natural
from truearc.sim.infer.fit import BaselineFit, out_of_range
from truearc.sim.infer.likelihood.layout import is_tracker
from truearc.sim.infer.likelihood.linearization import linearise
from truearc.sim.infer.likelihood.score_table import Array, ScoreTable
from truearc.sim.physics.simulate import LAUNCH_STATE

MOST = 3                              # curves
BEFORE = frozenset(("distance_m", "hood_deg", "motor_ratio", *LAUNCH_STATE))
HALF = 0.5
UNABLE = "no simulation of single shots can hold the unexplained effect"
APART = ("scatter.", "curve.")        # columns that are not coefficients, beside those of a tracker's errors


@dataclass(frozen=True)
class Freed:
    """`term` with `values` holds the curve; fitted: with its points among the shared columns; evidence: these and the
    other shared ones alone; `said` in short. beside: the step's name that was put in before it, if any."""

    term: str
    values: dict[str, float]
    curve: Curve
    fitted: BaselineFit
    evidence: ScoreTable
    said: str
    beside: str = ""


def all_freed(step: Step, search: Search) -> tuple[tuple[Freed, ...], str]:
    """(curves of the unexplained step, then of the misfit beside them, each clearly better on unseen shots; why one was
    left out, if it was).

    Left out: beside which a coefficient comes to the end of what is possible; which explains nothing once it is flown;
    an effect that no simulation of single shots can hold (two covariates together; a launch to one side, on which no
    height depends); a second curve of the same thing. Without tracks also the first where it is not clearly better on
    unseen shots, and any other: outcomes let a curve follow chance (of fourteen ten forecast another session worse).
    """
    fitted, correction = _likeliest(step)
    if correction is None:
        return (), ""
    beside = step.change is not None and bool(step.change.names)       # its posterior has been compared with a pair's
    if not fitted.intake.filmed and not (correction.gain.sum() > 0.0 if beside else clearly(
            correction.gain, fitted)):
        return (), "the free curve is not clearly better on unseen shots"
    found: list[Freed] = []
    while correction is not None and len(found) < MOST:
        foreseeable = _foreseeable(fitted, correction, search)
        others = () if foreseeable is correction else (correction,)
        one, why = _first_possible(fitted, (foreseeable, *others))
        if one is None:
            return tuple(found), "" if found and why == UNABLE else why
        found.append(one if found or step.change is None else replace(one, beside="".join(step.change.names)))
        fitted = one.fitted
        correction = _what_is_left(fitted, search) if fitted.intake.filmed else None
    return tuple(found), ""


def _likeliest(step: Step) -> tuple[BaselineFit, Correction | None]:
    """(the fit, with the name beside which the likeliest change stands; that change, else the one that was found)."""
    change, fitted = step.change, step.fitted
    if change is None or change.family is None:
        return fitted, None if step.place is None else step.place.correction
    if change.names:
        fitted = promote(fitted, step.naming.refits[change.names[0]])
    column = fitted.evidence.index(change.family.column)
    return fitted, correct(fitted.evidence, Test(FREE, column, change.family.what, "smooth",
                                                 np.ones(len(fitted.evidence.rows))))


def _first_possible(fitted: BaselineFit, corrections: tuple[Correction, ...]) -> tuple[Freed | None, str]:
    """(the first of them that may be believed, why the last one may not)."""
    why = ""
    for correction in corrections:
        one = freed(fitted, correction)
        if one is None:
            why = UNABLE
        elif beyond := _impossible(one):
            why = f"beside the free curve {', '.join(beyond)} would be impossible"
        elif one.evidence.log_score.sum() <= fitted.evidence.log_score.sum():
            why = "the free curve explains nothing once it is flown"
        else:
            return one, ""
    return None, why


def _foreseeable(fitted: BaselineFit, correction: Correction, search: Search) -> Correction:
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
    other = correct(fitted.evidence, replace(test, what=test.what.led_by(BEFORE)))
    return other if other.gain.sum() >= HALF * correction.gain.sum() else correction


def freed(fitted: BaselineFit, correction: Correction) -> Freed | None:
    """None for what cannot be taken."""
    column = fitted.evidence.columns[correction.test.column]
    taken, curve = term_of(column, fitted.layout), _curve(correction)
    if taken is None or curve is None:
        return None
    curve, whole, evidence = _fly(fitted, correction, *taken, curve)
    goes = f" by {curve.covariate}" if curve.covariate else ""
    return Freed(*taken, curve, whole, evidence, f"{column.name}{goes}")


def _impossible(free: Freed) -> list[str]:
    values = zip(free.evidence.columns, map(float, free.evidence.point), strict=True)
    among = free.fitted.layout.chain.catalogue
    return out_of_range({column.name: value for column, value in values if column.kind == "shared"
                         and not column.name.startswith(APART) and not is_tracker(column, among)}, among)


def _what_is_left(fitted: BaselineFit, search: Search) -> Correction | None:
    """The free change that explains most of what is left beyond chance, of those that a curve can take."""
    left = search.left(fitted)
    if left is None:
        return None
    asked, judged = left
    able = np.array([k for k, test in enumerate(asked.tests) if test.family == FREE and _can(fitted, test)], dtype=int)
    if not len(able):
        return None
    best = able[judged.gain[able].argmax()]      # not the plainest: what it leaves would be found again
    correction = correct(fitted.evidence, asked.tests[best])
    return correction if clearly(correction.gain, fitted) else None


def _can(fitted: BaselineFit, test: Test) -> bool:
    return term_of(fitted.evidence.columns[test.column], fitted.layout) is not None


def _fly(fitted: BaselineFit, correction: Correction, term: str, values: dict[str, float],
         curve: Curve) -> tuple[Curve, BaselineFit, ScoreTable]:
    """(the curve, all, shared evidence) where the simulation that has both fits best."""
    by = curve.by(_columns(correction), len(fitted.intake.rows))
    intake, layout, top, evidence = climb_with(fitted, term, values, curve, by)
    found = curve.moved({key: float(evidence.point[k]) for k, key in enumerate(curve.fitted)})
    if curve.covariate:
        found = found.moved({curve.keys[-1]: float(by.mean(0) @ found.points)})
    return found, BaselineFit(intake, layout, top, linearise(intake, layout, top)[0]), evidence


def _columns(correction: Correction) -> dict[str, Any]:
    """The covariate of each of the evidence's shots, by name."""
    what, rows = correction.test.what, correction.evidence.rows
    if isinstance(what, Covariate):
        return {what.name: what.values[rows]}
    return {what.name: [what.levels[code] if code >= 0 else "" for code in what.codes[rows]]} if isinstance(
        what, Factor) else {}


def _curve(correction: Correction) -> Curve | None:
    what, amplitude = correction.test.what, correction.amplitude
    rows, otherwise = correction.evidence.rows, float(correction.amplitude.mean())
    if what is None:
        return Curve((), otherwise)
    if isinstance(what, Factor):
        codes = what.codes[rows]
        seen = [k for k in range(len(what.levels)) if (codes == k).any()]
        return Curve(tuple(float(amplitude[codes == k][0]) for k in seen), otherwise, what.name,
                     levels=tuple(what.levels[k] for k in seen))
    if isinstance(what, CovariatePair) or not isinstance(what, Covariate):
        return None
    return _spline(what, rows, amplitude, otherwise)


def _spline(what: Covariate, rows: Int[Array, " n"], amplitude: Float[Array, " n"], otherwise: float) -> Curve:
    """Values at the fit's own knots: between them the fit is that very spline."""
    x = what.values[rows]
    said = np.isfinite(x)
    knots = spline_knots(x[said])
    value = np.linalg.lstsq(natural(knots, x[said]), amplitude[said], rcond=None)[0]
    return Curve(tuple(map(float, value)), otherwise, what.name, at=tuple(map(float, knots)),
                 low=float(x[said].min()), high=float(x[said].max()))
