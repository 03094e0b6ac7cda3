"""Construction of the finding of an investigation, in the format truearc.finding/1."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from msgspec import UNSET, UnsetType, structs

from truearc.sim.data.dataset import Dataset
from truearc.sim.discover import finding as parts
from truearc.sim.discover.decide import LIKELY, Search, Step, verdict_of
from truearc.sim.discover.detect import battery
from truearc.sim.discover.detect.battery import Asked, Judged, can_compare, compare_trackers, name_of
from truearc.sim.discover.detect.covariates import Covariate, carried_by, followed_column
from truearc.sim.discover.detect.localization import Place, contrast_of, size_weights, times_of
from truearc.sim.discover.finding import FindingRecord, FitSummary, FoundEffect, Named, TestResult, Unknown, Where
from truearc.sim.discover.identifiability import sight_of
from truearc.sim.discover.next_steps import blind_terms, has_spin, measure_blind, measure_terms, next_steps
from truearc.sim.discover.report import finding_text as wording
from truearc.sim.discover.report import story as stories
from truearc.sim.discover.select.simulations import end_errors, side_errors, times_off
from truearc.sim.infer.fit_report import say_tracker_errors
from truearc.sim.infer.intervals import NumberChange, tracker_errors
from truearc.sim.infer.launcher import LauncherFit, improbable, odd_places, stopped
from truearc.sim.infer.likelihood.data import Intake, number_columns
from truearc.sim.infer.likelihood.outcomes import best_class
from truearc.sim.infer.likelihood.score_table import Array, ScoreTable, clustered_error
from truearc.sim.physics.catalogue import CURVE, Catalogue
from truearc.sim.physics.term import STAGES
from truearc.sim.statistics import Z90

SHOWN = 40                            # lines of the tests that the answer lists; chosen: a page
RANKED = 12                           # names that it lists; chosen: a page


def silent(dataset: Dataset, intake: Intake, terms: tuple[str, ...], false_alarm: float) -> FindingRecord:
    """The finding of data that carry no test."""
    data = parts.DataSummary(len(dataset.shots), intake.level, intake.left_out, terms, {}, {"by": "shot", "count": 0},
                             dataset.accepted, untested(dataset), notes=dataset.notes())
    nowhere = Where(None, None, None, None, {}, None, None, (), "the data carry no test")
    story = stories.no_test(len(dataset.shots))
    return FindingRecord(data, parts.Mismatch(False, None, false_alarm, {}, 0, {}), nowhere, "none", story.text, None,
                         None, story=story)


def untested(dataset: Dataset) -> tuple[str, ...]:
    """Return the kinds of effects that need columns which the dataset lacks."""
    lacks = [] if dataset.shots.timed else [
        "what goes with the order of the shots, such as wear and hood backlash: not every shot has its t_s"]
    if not has_spin(dataset):
        lacks.append("lift and what else goes with the ball's spin: no shot has its exit_spin_rev_s, and rising air "
                     "may stand for it")
    return tuple(lacks)


def _has_topspin(dataset: Dataset) -> bool:
    spin_rev_s = number_columns(dataset).get("exit_spin_rev_s", np.zeros(0))
    known = spin_rev_s[np.isfinite(spin_rev_s)]
    return bool(len(known) and np.median(known) < 0.0)


def make_finding(dataset: Dataset, terms: tuple[str, ...], fitted: LauncherFit, asked: Asked, judged: Judged,
                 place: Place | None, steps: Sequence[Step], search: Search) -> FindingRecord:
    """Put it together; without steps nothing was found."""
    intake, among, false_alarm = fitted.model.data, fitted.model.catalogue, search.false_alarm
    lacks, topspin, doubted = untested(dataset), _has_topspin(dataset), _improbable(fitted, steps)
    believed = fitted.scores.shared_only()
    best = next((step.refit.scores for step in reversed(steps) if not step.unknown or step.withheld), believed)
    at_limit = {name: value for name, value in stopped(believed, among).items()
                if not name.startswith("scatter.")}                      # scatters take what is missing
    numbers = {name: value for name, value in fitted.values.items() if not name.startswith(CURVE + ".")}
    data = parts.DataSummary(len(dataset.shots), intake.level, intake.left_out, terms, {"all": numbers},
                             {"by": "shot", "count": len(dataset.shots)}, dataset.accepted, lacks, topspin,
                             at_limit | stopped(best, among), doubted, dataset.notes())
    results = results_of(fitted.scores, asked, judged, false_alarm)
    mismatch = parts.Mismatch(bool(steps), judged.p_any, false_alarm, results, len(asked.tests), judged.families)
    fit = _fit(fitted, steps)
    if not steps:
        return _nothing(data, mismatch, fit, fitted, judged, search)
    tracker, said, to_check = _tracker(fitted, search)
    first = steps[0]
    where = _where(first, judged, search, first.naming.probability)
    leading, *rest = map(_further, (first, *steps[1:]))
    verdict = verdict_of(first, fitted, None if search.home is None else search.home.fitted)
    leading = structs.replace(leading, what=_beside_rivals(leading.what, verdict.rivals, among), set=verdict.terms)
    found = FindingRecord(data, mismatch, where, verdict.verdict, "", leading.unknown, fit, what=leading.what,
                          set=leading.set, next=(*next_steps(dataset, first, leading.set), *to_check),
                          also=tuple(rest), unexplained=first.unexplained, tracker=tracker, withheld=leading.withheld)
    return stories.tell(found, place, among, said, (wording.say_limits(data.at_limit),
                                                    wording.say_improbable(data.improbable)))


def _nothing(data: parts.DataSummary, mismatch: parts.Mismatch, fit: FitSummary, fitted: LauncherFit, judged: Judged,
             search: Search) -> FindingRecord:
    """The finding of shots that show no effect: what could not have been seen, and errors of the tracker if any."""
    among, believed = fitted.model.catalogue, fitted.scores.shared_only()
    threshold = judged.threshold(battery.TERMS, search.false_alarm)
    sight = sight_of(fitted.scores, "", (), threshold)
    blind = blind_terms(sight) if np.isfinite(threshold) else []
    errors = tracker_errors(believed, among) if search.home is None else ()
    tracker, said, to_check = _wrong_tracker(errors, among) if errors else _tracker(fitted, search)
    to_see = measure_blind(blind, fitted.model.data.samples is not None, among)
    odd = {name: remark for name, remark in odd_places(believed, among).items() if name not in data.improbable}
    doubts = (wording.say_limits(data.at_limit), wording.say_improbable(data.improbable),
              wording.say_odd(odd.values()), wording.say_scatter(times_off(fitted)))
    where = Where(None, None, None, None, {}, None, None, (), "nothing was found")
    found = FindingRecord(data, mismatch, where, "none", "", None, fit, next=(*to_check, *to_see), tracker=tracker)
    if not errors and not isinstance(tracker, FoundEffect):
        return stories.tell_none(found, blind, sight, among, limits=(*doubts, said))
    return stories.tell_none(found, blind, sight, among, said, doubts)


TrackerFinding = tuple[FoundEffect | UnsetType, str, tuple[dict[str, Any], ...]]


def _wrong_tracker(errors: Sequence[Sequence[NumberChange]], among: Catalogue) -> TrackerFinding:
    """As _tracker, of errors that these tracks show by themselves."""
    what = tuple(_changed(one, among) for found in errors for one in found)
    names = tuple(dict.fromkeys(one.term for one in what))
    said = "".join(f" {line[:1].upper()}{line[1:]}." for line in say_tracker_errors(errors, among))
    return (FoundEffect(what, None if all(len(found) == 1 for found in errors) else names, None),
            f"{said} An effect that no term here explains may look like that.", measure_terms(among.find(names)))


def _tracker(fitted: LauncherFit, search: Search) -> TrackerFinding:
    """(change of the tracker's calibration since home and what it may be instead, in a sentence, what to measure)."""
    among = fitted.model.catalogue
    moved = None if search.home is None else compare_trackers(fitted, search.home.fitted, search.false_alarm)
    if moved is None:
        compared = search.home is not None and can_compare(fitted, search.home.fitted)
        return UNSET, wording.SAME_TRACKER if compared else "", ()
    what = tuple(_changed(one, among) for one in moved.numbers)
    together = [one for one, number in zip(what, moved.numbers, strict=True) if number.name in moved.together]
    found = FoundEffect(what, None if len(together) == len(what) else tuple(one.term for one in what), None)
    return found, stories.say_tracker(found, together, moved.p_value, among), measure_terms(
        among.find([one.term for one in what]))


def _beside_rivals(what: tuple[Named, ...], rivals: Sequence[NumberChange], among: Catalogue) -> tuple[Named, ...]:
    """The names, with what may have changed in place of the first of the rivals, which is one of them."""
    if not rivals:
        return what
    weighed = {one.name.partition(".")[0]: _changed(one, among) for one in rivals}
    first = next(one for one in what if one.term == rivals[0].name.partition(".")[0])
    weighed[first.term] = structs.replace(first, probability=first.probability * weighed[first.term].probability)
    return tuple(sorted((*weighed.values(), *(one for one in what if one.term not in weighed)),
                        key=lambda one: -one.probability))


def _changed(one: NumberChange, among: Catalogue) -> Named:
    name, _, parameter = one.name.partition(".")
    (term,) = among.find([name])
    interval = interval_about(one.change, one.sd, one.unit)
    return Named(name, one.probability, {parameter: interval}, term.sentence, term.stage)


def _improbable(fitted: LauncherFit, steps: Sequence[Step]) -> dict[str, float]:
    """Fitted numbers that were believed all but impossible; beside what was found those of the tracker alone: others
    are what a missing effect moves."""
    if not steps:
        return improbable(fitted.model.layout, fitted.scores.point)
    found = next((step.refit for step in reversed(steps) if not step.unknown), None) or fitted
    return {name: value for name, value in improbable(found.model.layout, found.scores.point).items()
            if name.startswith("track_") and name not in found.names}


def _further(step: Step) -> FoundEffect:
    """The result of one step."""
    probability = step.naming.probability
    what = tuple(_named(step, name, probability) for name in list(step.naming.probability)[:RANKED])
    chosen = None if step.unknown else tuple(name.partition(".")[0] for name in step.chosen)
    return FoundEffect(what, chosen, _unknown(step) if step.unknown else None, step.unexplained,
                       step.withheld or UNSET)


def _where(step: Step, judged: Judged, search: Search, probability: dict[str, float]) -> Where:
    evidence, place = step.fitted.scores, step.place
    stage_of = {column.name: column.stage for column in evidence.columns}
    mass = {stage: sum(p for name, p in probability.items() if stage_of[name] == stage) for stage in STAGES}
    rest = step.unexplained
    if place is not None:
        mass = {stage: value + rest * place.stage_probability[stage] for stage, value in mass.items()}
    total = sum(mass.values())
    mass = {stage: value / total if total > 0.0 else 1.0 / len(mass) for stage, value in mass.items()}
    stage = max(mass, key=lambda name: mass[name])
    reason = None if mass[stage] > LIKELY else "stage: these data cannot tell the likely stages apart"
    covariate, direction, others = _follows(step, judged, search)
    times = None
    if evidence.plane is None or step.fitted.model.data.samples is not None:
        times = _until_seen(step.fitted.model.data, times_of(evidence, place.test)) if place is not None else None
    return Where(stage, mass, covariate, direction, place.region if place else {}, times,
                 place.column.name if place else None, others, reason)


def _until_seen(intake: Intake, times: tuple[float, float] | None) -> tuple[float, float] | None:
    """The last band of time has no end of its own: it ends with the longest track."""
    if times is None or intake.samples is None:
        return times
    longest_s = (np.asarray(intake.lanes.lead_s)[intake.tracked, None] + intake.samples.time_s).max()
    return times[0], float(min(times[1], longest_s))


def _follows(step: Step, judged: Judged, search: Search) -> tuple[str | None, str | None, tuple[str, ...]]:
    """(covariate, direction, other names that go with the same shots)."""
    place, column = step.place, step.column
    free = None if place is None else name_of(place.test, place.column)
    sure = place is not None and judged.p_value[place.number] <= search.false_alarm if step.base == () else True
    if step.unknown and place is not None:
        name, direction = free, place.column.direction
    elif followed := followed_column(column.follows, search.covariates):
        name, direction = followed, column.direction
    else:
        name, direction = (free if sure else None), column.direction
    others: tuple[str, ...] = ()
    if place is not None and isinstance(place.test.what, Covariate) and name == free:
        what = place.test.what
        others = tuple(n for n in what.names if n != name) + carried_by(what, search.factors)
    return name, direction, others


def _unknown(step: Step) -> Unknown | None:
    place = step.place
    if place is None:
        return None
    size, sd = contrast_of(place.correction, size_weights(place.correction))
    reach = Z90 * sd
    return Unknown(name_of(place.test, place.column), place.column.direction, size, place.column.unit, size - reach,
                   size + reach)


def _named(step: Step, name: str, probability: dict[str, float]) -> Named:
    """One name with its size over all hypotheses that have it; of a number that was believed, its change and value."""
    term_name, _, parameter = name.partition(".")
    (term,) = step.fitted.model.catalogue.find([term_name])
    column, naming = step.fitted.scores.columns[step.fitted.scores.index(name)], step.naming
    size = parts.Interval(*naming.told(step.fitted, name), column.unit)
    before, found = step.fitted.model.layout.believed.get(name), naming.refits.get(name)
    if before is None:
        return Named(term_name, probability[name], {parameter: size}, term.sentence, column.stage)
    now, sd = before + size.value, size.sd
    if found is not None:             # the new value may be known where the old one was not, nor the change
        now = float(found.value[0] + size.value - found.amplitude[0])
        sd = float(np.sqrt(found.scores.covariance[0, 0] + max(sd**2 - found.sd[0]**2, 0.0)))
    return Named(term_name, probability[name], {parameter: interval_about(now, sd, column.unit)}, term.sentence,
                 column.stage, before, size)


def interval_about(value: float, sd: float, unit: str) -> parts.Interval:
    """Return the 90 % interval of a normal number."""
    return parts.Interval(value, sd, value - Z90 * sd, value + Z90 * sd, unit)


def results_of(evidence: ScoreTable, asked: Asked, judged: Judged, false_alarm: float) -> dict[str, TestResult]:
    """Return the strongest shape of each column and covariate, SHOWN of them: found ones first, by what they explain.
    """
    best: dict[str, tuple[tuple[float, float], TestResult]] = {}
    for k, test in enumerate(asked.tests):
        column = evidence.columns[test.column]
        covariate = name_of(test, column)
        key = column.name + (f" ~ {covariate}" if covariate and not column.follows else "")
        result = TestResult(column.stage, column.direction, covariate, test.shape, float(judged.statistic[k]),
                            float(judged.p_each[k]), float(judged.p_value[k]), float(judged.amplitude[k]), column.unit,
                            float(judged.gain[k]))
        rank = (max(result.p_value, false_alarm), -result.log_gain)
        if key not in best or rank < best[key][0]:
            best[key] = (rank, result)
    return {key: result for key, (_, result) in sorted(best.items(), key=lambda item: item[1][0])[:SHOWN]}


def _fit(fitted: LauncherFit, steps: Sequence[Step]) -> FitSummary:
    """Figures on unseen shots: as believed, and with every named effect (log score: with the last free curve, too)."""
    believed = fitted.without_terms()
    null = believed.scores
    before_change = null.held_out_change()
    before = null.log_score + null.gain(before_change)
    accuracy = _accuracy(null, before_change)
    rmse = end_errors(believed, before_change)
    height_at = "track end" if fitted.model.data.filmed else "plane"
    if not steps:
        return FitSummary(len(null.rows), float(before.mean()), None, None, None, rmse, None, accuracy, None, height_at)
    last, named = steps[-1], [step.refit for step in steps if not step.unknown]
    after = last.average
    if last.unknown:
        after = last.free if last.free is not None else last.before
    rmse_after = accuracy_after = None
    side: tuple[float | UnsetType, float | UnsetType] = UNSET, UNSET
    if named:
        change = named[-1].scores.held_out_change()
        first = next(step for step in steps if not step.unknown)
        if fitted.model.data.filmed and first.column.direction == "lateral":
            side = side_errors(believed, before_change), side_errors(named[-1], change)
        rmse_after = end_errors(named[-1], change)
        accuracy_after = _accuracy(named[-1].scores, change)
    gain = after - before
    return FitSummary(len(null.rows), float(before.mean()), float(after.mean()), float(gain.mean()),
               clustered_error(gain, null.together), rmse, rmse_after, accuracy, accuracy_after, height_at, *side)


def _accuracy(evidence: ScoreTable, change: Float[Array, "n P"]) -> float | None:
    """Share of recorded outcomes that were the likeliest."""
    if evidence.plane is None:
        return None
    seen, mean_m, spread_m = evidence.heights(change)
    classed = np.isfinite(seen.classes)
    if not classed.any():
        return None
    return float(np.mean((best_class(seen, mean_m, spread_m) == seen.classes)[classed]))
