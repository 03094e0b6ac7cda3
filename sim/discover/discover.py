"""Discovery, first form: is there a mismatch, and where? It names nothing yet."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sim.discover import outcomes
from sim.discover.correct import Correction, clustered_error
from sim.discover.covariates import Covariate, Factor, carried_by, gather_covariates, gather_factors
from sim.discover.evidence import Evidence
from sim.discover.family import Clusters, Test, ask_everything, find_clusters, name_of
from sim.discover.finding import Data, Finding, Fit, Mismatch, TestResult, Unknown, Where
from sim.discover.gather import Gathered, gather
from sim.discover.locate import Place, amplitude_of, locate
from sim.discover.outcome_evidence import OutcomeEvidence
from sim.discover.statistics import Flips, flip_signs
from sim.discover.track_evidence import end_forecasts
from sim.discover.words import say_mismatch, say_none
from sim.shots import Dataset

Progress = Callable[[float, str], None]
DRAWS = 1999
FALSE_ALARM = 0.05
SHOWN = 40                            # lines of the family that the answer lists


@dataclass(frozen=True)
class Investigation:
    """The answer, and what the report draws from."""

    finding: Finding
    gathered: Gathered
    place: Place | None
    tests: tuple[Test, ...]


def discover(dataset: Dataset, believed: Sequence[str] | None = None, false_alarm: float = FALSE_ALARM, seed: int = 0,
             progress: Progress = lambda done, note: None) -> Investigation:
    """Fit the believed terms, test whether anything is left over, and say where.

    believed: names of terms, the rig's own list when None. The same data and seed give the same answer. BadInput for
    an unknown term, too few shots, or outcomes without a target.
    """
    terms = tuple(dataset.facts.believe.terms if believed is None else believed)
    gathered = gather(dataset, terms, lambda done, note: progress(0.5 * done, note))
    if not gathered.evidences:
        return Investigation(_silent(dataset, gathered, terms, false_alarm), gathered, None, ())
    clusters = find_clusters(dataset.shots)
    factors = gather_factors(dataset.shots)
    tests, scores = ask_everything(gathered.evidences, gather_covariates(dataset), factors, clusters)
    if not tests:
        return Investigation(_silent(dataset, gathered, terms, false_alarm), gathered, None, ())
    flips = flip_signs(scores, DRAWS, seed, lambda done, note: progress(0.5 + 0.3 * done, note))
    place = locate(gathered.evidences, tests, flips, false_alarm, clusters, seed)
    progress(1.0, "done")
    finding = _finding(dataset, gathered, terms, clusters, tests, flips, place, false_alarm)
    return Investigation(finding, gathered, place, tests)


def _finding(dataset: Dataset, gathered: Gathered, terms: tuple[str, ...], clusters: Clusters, tests: Sequence[Test],
             flips: Flips, place: Place, false_alarm: float) -> Finding:
    p_value = float(flips.p_family.min())
    found = p_value <= false_alarm
    data = _data(dataset, gathered, terms, {"by": clusters.by, "count": clusters.count})
    results = _results(gathered.evidences, tests, flips, false_alarm)
    mismatch = Mismatch(found, p_value, false_alarm, results, len(tests))
    if not found:
        fit = _fit(gathered, place.correction, clusters, False)
        return Finding(data, mismatch, _nowhere("nothing was found"), "none",
                       say_none(terms, p_value, data.shots, false_alarm), None, fit)
    where = _where(place, gather_factors(dataset.shots))
    evidence = gathered.evidences[place.test.evidence]
    unknown = Unknown(where.covariate, place.channel.direction, amplitude_of(evidence, place.correction),
                      place.channel.unit, None)
    return Finding(data, mismatch, where, "unknown",
                   say_mismatch(terms, p_value, where, unknown, place.channel.words), unknown,
                   _fit(gathered, place.correction, clusters, True))


def _silent(dataset: Dataset, gathered: Gathered, terms: tuple[str, ...], false_alarm: float) -> Finding:
    """Data that can say nothing."""
    return Finding(_data(dataset, gathered, terms, {"by": "shot", "count": len(dataset.shots)}),
                   Mismatch(False, None, false_alarm, {}, 0), _nowhere("the data carry no test"), "none",
                   say_none(terms, None, len(dataset.shots), false_alarm), None, None)


def _data(dataset: Dataset, gathered: Gathered, terms: tuple[str, ...], clusters: dict) -> Data:
    return Data(len(dataset.shots), gathered.level, gathered.left_out, terms, gathered.fitted, clusters)


def _where(place: Place, factors: tuple[Factor, ...]) -> Where:
    name = name_of(place.test, place.channel)
    reason = None
    if place.stage is None:
        reason = "stage: these data cannot tell the likely stages apart; a correction of either does about as well"
    what = place.test.what
    others: tuple[str, ...] = ()
    if isinstance(what, Covariate):
        others = tuple(n for n in what.names if n != name) + carried_by(what, factors)
    return Where(place.stage, place.stage_probability, name, place.channel.direction, place.region, place.times_s,
                 place.channel.name, others, reason)


def _nowhere(reason: str) -> Where:
    return Where(None, None, None, None, {}, None, None, (), reason)


def _results(evidences: Sequence[Evidence], tests: Sequence[Test], flips: Flips,
             false_alarm: float) -> dict[str, TestResult]:
    """The strongest shape of each channel and covariate, SHOWN of them: found ones first, by what they explain."""
    best: dict[str, tuple[tuple[float, float], TestResult]] = {}
    for k, test in enumerate(tests):
        evidence = evidences[test.evidence]
        channel = evidence.channels[test.channel]
        covariate = name_of(test, channel)
        key = f"{evidence.kind}: {channel.name}" + (f" ~ {covariate}" if covariate and not channel.follows else "")
        result = TestResult(channel.stage, channel.direction, covariate, test.shape, float(flips.statistic[k]),
                            float(flips.p_each[k]), float(flips.p_family[k]), float(flips.amplitude[k]), channel.unit,
                            float(flips.gain[k]))
        rank = (max(result.p_value, false_alarm), -result.log_gain)
        if key not in best or rank < best[key][0]:
            best[key] = (rank, result)
    ordered = sorted(best.items(), key=lambda item: item[1][0])[:SHOWN]
    return {key: result for key, (_, result) in ordered}


def _fit(gathered: Gathered, correction: Correction, clusters: Clusters, corrected: bool) -> Fit:
    """Figures on unseen shots of the evidence that the correction belongs to; after is None when nothing was found."""
    evidence = gathered.evidences[correction.test.evidence]
    rmse, accuracy = _heights(gathered, evidence, correction)
    error = clustered_error(correction.gain, clusters.label[evidence.rows])
    after = (float(correction.log_after.mean()), float(correction.gain.mean()), error) if corrected else (None,) * 3
    return Fit(len(evidence.rows), float(correction.log_before.mean()), after[0], after[1], after[2],
               rmse[0], rmse[1] if corrected else None, accuracy[0], accuracy[1] if corrected else None)


def _heights(gathered: Gathered, evidence: Evidence,
             correction: Correction) -> tuple[tuple[float | None, ...], tuple[float | None, ...]]:
    """((rmse before, after), (accuracy before, after)); None where the evidence has no such thing.

    Tracks: the height at the end of each, forecast from its first part. Outcomes: measured heights, and the likeliest
    class against the one recorded.
    """
    if evidence.kind == "tracks" and gathered.tracks is not None and gathered.columns is not None:
        column = correction.test.channel
        errors = end_forecasts(gathered.tracks, gathered.columns[..., column], correction.after[:, column])
        return tuple(float(np.sqrt(np.mean(e**2))) for e in errors), (None, None)
    if not isinstance(evidence, OutcomeEvidence):
        return (None, None), (None, None)
    seen, pairs = evidence.plane.seen, [evidence.corrected(change) for change in (correction.before, correction.after)]
    measured, classed = seen.measured, np.isfinite(seen.classes)
    rmse = tuple(float(np.sqrt(np.mean((mean - seen.height_m)[measured]**2))) if measured.any() else None
                 for mean, _ in pairs)
    accuracy = tuple(float(np.mean((outcomes.best_class(seen, *pair) == seen.classes)[classed])) if classed.any()
                     else None for pair in pairs)
    return rmse, accuracy
