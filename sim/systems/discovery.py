"""Discovery on a system: the engine's tests, names and verdict, and what of them a better simulator takes over."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float
from msgspec import UNSET, structs

from truearc.errors import InputError
from truearc.sim.discover import finding as parts
from truearc.sim.discover.decide import Search, Step, decide, gain_interval, judge_left, verdict_of
from truearc.sim.discover.detect.battery import ALLOWANCE, TERMS, judge, name_of
from truearc.sim.discover.detect.covariates import Covariate, covariates_among, factors_among
from truearc.sim.discover.detect.localization import contrast_of, locate, size_weights
from truearc.sim.discover.finding import FindingRecord, FitSummary, FoundEffect, Interval, Named, Unknown, Where
from truearc.sim.discover.identifiability import Sight, sight_of
from truearc.sim.discover.next_steps import contest_of, worth
from truearc.sim.discover.report.build_finding import results_of
from truearc.sim.discover.select.posterior import climb_carried
from truearc.sim.discover.select.terms import TOLD_APART, one_step
from truearc.sim.infer.fit import Fit, climb, fit_believed
from truearc.sim.infer.likelihood.score_table import Array, clustered_error, folds_of
from truearc.sim.printed import Progress, part_of
from truearc.sim.statistics import Z90
from truearc.sim.systems import candidates as what
from truearc.sim.systems.candidates import Along, Candidate
from truearc.sim.systems.flight import is_traced
from truearc.sim.systems.score_table import PIECES, SystemModel
from truearc.sim.systems.system import Believed, Runs, SystemSpec

ONE_NAME = 0.98                       # correlation of scores above which candidates are one name (the design)
FEWEST_ROWS = 8                       # that signs of a test need, as for shots
LISTED = 12                           # names in an answer; chosen: a page
PLANNED = 8                           # further runs that a plan proposes; chosen: an afternoon
REACH = (0.5, 2.0)                    # of the recorded range of a condition, where a plan looks; chosen
INSTEAD = 0.95                        # correlation from which two parameters cannot be told apart
SystemFitted = Fit[Any]


@dataclass(frozen=True, eq=False)
class SystemInvestigation:
    """A finding with the fits behind it. more: the fit with everything that is adopted; None if nothing is."""

    system: SystemSpec
    runs: Runs
    finding: FindingRecord
    fitted: SystemFitted | None = None
    steps: tuple[Step, ...] = ()
    more: SystemFitted | None = None
    sight: Sight | None = None

    @property
    def model(self) -> SystemModel:
        assert self.fitted is not None
        model: SystemModel = self.fitted.model
        return model

    @property
    def refused(self) -> str:
        """Why what was found is not adopted; "" otherwise."""
        fit = self.finding.fit
        interval = None if fit is None else gain_interval(fit)
        if self.more is not None and interval is not None and interval[1] < 0.0:
            return "forecasts of runs left out are worse with it (90 % interval)"
        return ""

    def adopt(self) -> SystemSpec:
        """Return the system with fitted numbers and, unless refused, with the missing part in it.

        Raises:
            InputError: the runs carry no test, so nothing was fitted.
        """
        if self.fitted is None:
            raise InputError("adopt: the runs carry no test, so nothing was fitted")
        taken = self.fitted.without_terms() if self.more is None or self.refused else self.more
        return system_of(taken)


def system_of(fitted: SystemFitted) -> SystemSpec:
    """Return the system with what a fit found as its beliefs."""
    model: SystemModel = fitted.model
    scores, system = fitted.scores, model.system
    sd = np.sqrt(np.maximum(np.diag(scores.covariance), 1e-300))
    known = {column.name: (float(at), float(size)) for column, at, size in zip(scores.columns, scores.point, sd,
                                                                             strict=True)}
    believed = {name: Believed(float(one.value(known[name][0])), known[name][1], one.log)
                for name, one in system.believed.items()}
    earlier = {one.name for one, _ in system.found}
    found = [(one, Believed(*known[one.name])) for one, _ in system.found]
    curves: dict[Any, list[tuple[Any, float, float]]] = {}
    for number, (name, (at, size)) in enumerate(known.items()):
        if name in system.believed or name in earlier or name.startswith("scatter."):
            continue
        if name.startswith("curve."):
            entry = model.entries[model.layout.source[number]]
            slot = model.slots[entry.slot]
            curves.setdefault(slot.curve or slot.name, []).append((entry, at, size))
        else:
            slot = model.entries[model.layout.source[number]].slot
            found.append((model.labels[name].fixed(fitted.point.places[slot].tolist()), Believed(at, size)))
    found += [curve_of(model, name, many) for name, many in curves.items()]
    return system.with_beliefs(believed, tuple(found))


def curve_of(model: SystemModel, name: str, many: Sequence[tuple[Any, float, float]]) -> tuple[Candidate, Believed]:
    """Return an unexplained change as one candidate of amplitude 1."""
    slots = [model.slots[entry.slot] for entry, *_ in many]
    push = slots[0].push
    if slots[0].curve and push is not None:
        parts = [(one.push.law, at) for one, (_, at, _) in zip(slots, many, strict=True) if one.push is not None]
        whole = replace(push, law=lambda v: sum(at * law(v) for law, at in parts))
        return Candidate(f"found {name}", f"a smooth {name}", "1", 1.0, what.RATE, ("push", 0), push=whole,
                         direction=slots[0].direction), Believed(1.0, 0.1)
    total = np.sum([at * entry.weight for entry, at, _ in many], axis=0)
    along = None
    if np.ptp(total) > 0.0:
        values = {key: one for key, one in model.covariates.items() if np.ptp(one) > 0.0}
        key = max(values, key=lambda key: _smoothness(values[key], total))
        order = np.argsort(values[key], kind="stable")
        knots, first = np.unique(values[key][order], return_index=True)
        along = Along(key, 0.0, 1.0, curve=(tuple(knots.tolist()), tuple(total[order][first].tolist())))
    else:
        total = total[:1]
    usual = float(np.abs(total).max())
    base = slots[0]
    level = Believed(1.0, 0.1) if along else Believed(float(total[0]), max(0.1 * usual, 1e-12))
    return replace(base, name=f"found {name}", kind="term", along=along), level


def _smoothness(values: Float[Array, " R"], curve: Float[Array, " R"]) -> float:
    """Minus the roughness of a curve in the order of a covariate: highest for the one that it goes along."""
    return -float(np.abs(np.diff(curve[np.argsort(values, kind="stable")])).sum())


def fit_system(system: SystemSpec, runs: Runs, progress: Progress = lambda done, note: None) -> SystemFitted:
    """Fit the believed simulation alone."""
    model = SystemModel.of(system, runs, testing=False)
    return fit_believed(model.shared_only(), progress)


def one_name_each(fitted: SystemFitted) -> SystemFitted:
    """Return the fit with one candidate of those whose scores go together, the first; the others are its members.

    Strong effects tell even such candidates apart: they stay if a fit of one would lose TOLD_APART nats by the other.
    """
    found, alike = one_step(fitted.scores)
    model: SystemModel = fitted.model
    kept: list[int] = []
    members: dict[str, tuple[str, ...]] = {}
    for k, one in enumerate(found):
        twin = next((j for j in kept if abs(alike[k, j]) > ONE_NAME and 0.5 * (1.0 - alike[k, j]**2) * max(
            one.z**2, found[j].z**2) < TOLD_APART), None) if one.visible else None
        if twin is None:
            kept.append(k)
        else:
            members[found[twin].name] = (*members.get(found[twin].name, ()), one.name)
    gone = {found[k].column for k in range(len(found))} - {found[k].column for k in kept}
    columns = np.array([k for k in range(len(fitted.scores.columns)) if k not in gone])
    layout = replace(model.layout, columns=tuple(model.layout.columns[k] for k in columns),
                     source=model.layout.source[columns])
    return replace(fitted, model=replace(model, layout=layout, members=members), scores=fitted.scores.pick(columns))


def well_placed(fitted: SystemFitted) -> SystemFitted:
    """Return the fit with the last shape number of each candidate, such as a level, where one step favours it most."""
    model: SystemModel = fitted.model
    best, places, usual = dict.fromkeys(model.labels, -np.inf), model.places.copy(), {}
    for number, place in enumerate(what.TRIED):
        there = model.placed(place)
        sizes = {name: one.usual_at[number] for name, one in model.labels.items() if one.usual_at}
        tried = model.with_places(there, sizes)
        for one in one_step(tried.linearise(replace(fitted.point, places=there))[0])[0]:
            if one.nats > best[one.name]:
                slot = model.entries[model.layout.source[one.column]].slot
                best[one.name], places[slot] = one.nats, there[slot]
                usual[one.name] = sizes.get(one.name, fitted.scores.columns[one.column].usual)
    point, moved = replace(fitted.point, places=places), model.with_places(places, usual)
    return replace(fitted, model=moved, point=point, scores=moved.linearise(point)[0])


def investigate(system: SystemSpec, runs: Runs, say: Callable[["SystemInvestigation"], str],
                false_alarm: float = parts.FALSE_ALARM, seed: int = 0,
                progress: Progress = lambda done, note: None) -> SystemInvestigation:
    """Fit, test, locate and name, as `truearc.sim.discover.investigate.discover` does for a launcher; `say` words it.
    """
    model = SystemModel.of(system, runs)
    rows = len(model.recording.run)
    if rows < FEWEST_ROWS:
        why = f"{len(runs)} runs give {rows} rows; a test needs {FEWEST_ROWS} of like weight"
        return SystemInvestigation(system, runs, _cannot(model, false_alarm, why))
    every = fit_believed(model, part_of(progress, 0.0, 0.3))
    fitted = one_name_each(every)
    model = fitted.model
    covariates = covariates_among(model.covariates)
    search = Search(rows, covariates, factors_among(model.sessions), false_alarm, seed, None, "")
    scores = model.linearise(fitted.point, None, PIECES)[0]
    fine = replace(search, shots=len(scores.rows), covariates=tuple(
        Covariate(tuple((name, np.repeat(values, PIECES)) for name, values in one.columns)) for one in covariates),
        factors=tuple(replace(one, codes=np.repeat(one.codes, PIECES)) for one in search.factors))
    asked = fine.ask(replace(fitted, scores=scores))
    if not asked.tests:
        why = "no candidate has information in eight rows of like weight"
        return SystemInvestigation(system, runs, _cannot(model, false_alarm, why), fitted)
    judged = judge(asked.scores, [test.family for test in asked.tests], ALLOWANCE, parts.SIGN_DRAWS, seed,
                   part_of(progress, 0.3, 0.1))
    mismatch = parts.Mismatch(judged.p_any <= false_alarm, judged.p_any, false_alarm, results_of(
        fitted.scores, asked, judged, false_alarm), len(asked.tests), judged.families)
    sight = sight_of(fitted.scores, "runs", tuple(system.believed), judged.threshold(TERMS, false_alarm))
    steps: tuple[Step, ...] = ()
    if mismatch.found:
        fitted = one_name_each(well_placed(every))
        whole = search.ask(fitted)
        place = locate(fitted.scores, whole, judge_left(whole, seed), false_alarm, rows, seed) if whole.tests else None
        steps = decide(fitted, place, search, part_of(progress, 0.4, 0.5))
    more = _with_everything(steps)
    finding = _record(fitted, mismatch, steps, more)
    progress(1.0, "done")
    found = SystemInvestigation(system, runs, finding, fitted, steps, more, sight)
    return replace(found, finding=structs.replace(finding, sentence=say(found)))


def _with_everything(steps: Sequence[Step]) -> SystemFitted | None:
    """The fit with the names of every effect, or with the curve of one that has none."""
    if not steps:
        return None
    named = [step for step in steps if not step.unknown]
    if named:
        last = named[-1]
        if len(last.chosen) == 1:
            return last.refit
        model = last.fitted.model.shared_only(last.chosen)
        return climb(model, last.fitted.point)
    first = steps[0]
    if first.change is None or first.change.family is None:
        return None
    carried = first.fitted.model.carrying(first.fitted.point, False, first.change.family.part)
    return None if carried is None else climb_carried(carried)


def forecast_errors(fitted: SystemFitted) -> dict[str, float]:
    """Return {output: RMS error of forecasts of rows left out, from their first sample}."""
    bare = fitted.without_terms()
    model: SystemModel = bare.model
    change, fold, recording = bare.scores.held_out_change(), folds_of(len(bare.scores.rows)), model.recording
    square, count = np.zeros(len(model.system.outputs)), np.zeros(len(model.system.outputs))
    for held in range(fold.max() + 1):
        point = model.moved(bare.point, change[fold == held][0])
        off = (recording.seen - model.flights(replace(point, start=np.zeros_like(point.start))))[fold == held]
        square += np.nansum(off**2, axis=(0, 1))
        count += np.isfinite(off).sum((0, 1))
    return dict(zip(model.system.outputs, np.sqrt(square / np.maximum(count, 1)).tolist(), strict=True))


def _cannot(model: SystemModel, false_alarm: float, why: str) -> FindingRecord:
    data = _data(model, {}, 0)
    nowhere = Where(None, None, None, None, {}, None, None, (), "the runs carry no test")
    return FindingRecord(data, parts.Mismatch(False, None, false_alarm, {}, 0, {}), nowhere, "none",
                         f"These runs cannot test the simulator: {why}. Record more runs, or longer ones.", None, None)


def _data(model: SystemModel, fitted: dict[str, float], rows: int) -> parts.DataSummary:
    notes = list(model.recording.notes)
    if model.system.rate is not None and not is_traced(model.system):
        notes.append("the rate function cannot be traced by JAX: its slopes are differences")
    if model.recording.inputs.shape[2]:
        notes.append("inputs are taken as exact; where they come from the noisy outputs (feedback), the noise feeds "
                     "back and estimates are biased")
    return parts.DataSummary(len(model.recording.run), "runs", (), tuple(model.system.believed), {"all": fitted},
                             {"by": "run" if len(set(model.recording.run.tolist())) == len(model.recording.run)
                              else "block", "count": rows}, notes=tuple(notes))


def _record(fitted: SystemFitted, mismatch: parts.Mismatch, steps: Sequence[Step],
            more: SystemFitted | None) -> FindingRecord:
    model: SystemModel = fitted.model
    first, scores = fitted.scores.first_shared, fitted.scores
    numbers = {column.name: model.shown(column.name, float(at))
               for column, at in zip(scores.columns[first:], scores.point[first:], strict=True)}
    data = _data(model, numbers, len(scores.rows))
    fit = _summary(fitted, more)
    if not steps:
        where = Where(None, None, None, None, {}, None, None, (), "nothing was found")
        return FindingRecord(data, mismatch, where, "none", "", None, fit)
    leading, *rest = map(_effect, steps)
    verdict = verdict_of(steps[0], fitted, None)
    return FindingRecord(data, mismatch, _where(steps[0]), verdict.verdict, "", leading.unknown, fit, what=leading.what,
                         set=verdict.terms, next=plan(steps[0]), also=tuple(rest), unexplained=steps[0].unexplained,
                         withheld=leading.withheld)


def _summary(fitted: SystemFitted, more: SystemFitted | None) -> FitSummary:
    before = fitted.held_out()
    if more is None:
        return FitSummary(len(before), float(before.mean()), None, None, None, None, None, None, None, "run")
    after = more.without_terms().scores.held_out()
    gain = after - before
    return FitSummary(len(before), float(before.mean()), float(after.mean()), float(gain.mean()),
                      clustered_error(gain, fitted.scores.together), None, None, None, None, "run")


def _effect(step: Step) -> FoundEffect:
    probability = step.naming.probability
    names = []
    for name in list(probability)[:LISTED]:
        column = step.fitted.scores.columns[step.fitted.scores.index(name)]
        size = Interval(*step.naming.told(step.fitted, name), column.unit)
        names.append(Named(name, probability[name], {"size": size}, f"{step.fitted.model.label_of(name)}.",
                           column.stage))
    chosen = None if step.unknown else tuple(step.chosen)
    return FoundEffect(tuple(names), chosen, _unknown(step) if step.unknown else None, step.unexplained,
                       step.withheld or UNSET)


def goes_with(step: Step) -> tuple[str, str | None]:
    """Return (the changed part in words, what an unexplained effect goes with)."""
    family = None if step.change is None else step.change.family
    if family is not None:
        column = step.fitted.scores.columns[family.part.columns[0]]
        return family.column, column.follows or (None if family.what is None else family.what.name)
    if step.place is None:
        return "", None
    return step.place.column.name, name_of(step.place.test, step.place.column)


def _unknown(step: Step) -> Unknown | None:
    place = step.place
    if place is None:
        return None
    size, sd = contrast_of(place.correction, size_weights(place.correction))
    return Unknown(goes_with(step)[1], place.column.direction, size, place.column.unit, size - Z90 * sd,
                   size + Z90 * sd)


def _where(step: Step) -> Where:
    place, column = step.place, step.column
    stages = {} if place is None else dict(place.stage_probability)
    others: tuple[str, ...] = ()
    if place is not None and isinstance(place.test.what, Covariate):
        others = place.test.what.names[1:]
    covariate = goes_with(step)[1] if step.unknown else None
    return Where(column.stage if not step.unknown else max(stages, key=lambda one: stages[one], default=None), stages,
                 covariate, None, place.region if place else {}, None, place.column.name if place else None, others,
                 None)


def plan(step: Step) -> tuple[dict[str, Any], ...]:
    """Return the further runs that best separate the names of a set: a condition beyond the recorded range, if any."""
    names = tuple(name for name in step.chosen if name in step.naming.refits)
    if step.unknown or len(names) < 2:
        return ()
    fitted: SystemFitted = step.fitted
    model: SystemModel = fitted.model
    contest = contest_of(step, names)
    recording, found = model.recording, []
    moving = recording.inputs.shape[2]
    rows = np.resize(np.arange(len(recording.run)), PLANNED)
    for k, name in enumerate(model.names[moving:]):
        values = recording.conditions[:, k]
        for value in (REACH[0] * float(values.min()), REACH[1] * float(values.max())):
            conditions = recording.conditions.copy()
            conditions[:, k] = value
            there = replace(model, recording=replace(recording, conditions=conditions))
            more = there.reweighted().linearise(step.fitted.point)[0].told_by(rows)
            found.append((worth(contest, more), name, value))
    again = step.fitted.scores.told_by(rows)
    if not found:
        return ()
    best, name, value = max(found)
    if best <= worth(contest, again):
        return ()
    return ({"do": "run", "condition": name, "value": value, "runs": PLANNED, "separates": list(names)},)


def inseparable(fitted: SystemFitted) -> list[tuple[str, str, float]]:
    """Return pairs of parameters whose estimates go together, with their correlation."""
    bare = fitted.without_terms()
    names, covariance = [column.name for column in bare.scores.columns], bare.scores.covariance
    sd = np.sqrt(np.diag(covariance))
    own = [k for k, name in enumerate(names) if not name.startswith("scatter.")]
    return [(names[a], names[b], float(covariance[a, b] / (sd[a] * sd[b]))) for n, a in enumerate(own)
            for b in own[n + 1:] if abs(covariance[a, b]) > INSTEAD * sd[a] * sd[b]]


@dataclass(frozen=True, eq=False)
class Intervals:
    """Fitted numbers with 90 % intervals: [(name, value, low, high)]; the wider of the information's and the runs'."""

    fitted: SystemFitted
    rows: tuple[tuple[str, float, float, float], ...] = field(default=())

    @staticmethod
    def of(fitted: SystemFitted) -> "Intervals":
        bare = fitted.without_terms()
        model: SystemModel = bare.model
        covariance, score = bare.scores.covariance, bare.scores.score
        spread = covariance @ (score.T @ score) @ covariance
        sd = np.sqrt(np.maximum(np.diag(covariance), np.diag(spread)))
        ends = [(column.name, float(at), Z90 * float(size))
                for column, at, size in zip(bare.scores.columns, bare.scores.point, sd, strict=True)]
        return Intervals(fitted, tuple((name, model.shown(name, at), model.shown(name, at - reach),
                                        model.shown(name, at + reach)) for name, at, reach in ends))

    @cached_property
    def errors(self) -> dict[str, float]:
        return forecast_errors(self.fitted)


def foresee(system: SystemSpec, runs: Runs) -> tuple[Sight, SystemModel]:
    """Return what runs with these inputs could show, before any output is measured; and the model behind it."""
    if any(sd is None and name not in runs.columns for name, sd in system.outputs.items()):
        raise InputError("identifiability: state the noise of each output in observe={...}: it cannot be fitted before "
                         "there are recordings")
    model = SystemModel.of(system, runs, blind=True)
    point = model.starts()[0]
    return sight_of(model.linearise(point)[0], "runs", tuple(system.believed)), model
