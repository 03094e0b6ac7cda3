"""Discovery: the detection, localization and naming of a mismatch, and the gain from a simulation that includes it.

The belief from an investigation contains the fitted coefficients, every named effect, and their covariance.

A later session may use different balls. A fit with random effects of balls then attributes much of any change in the
robot to the balls and forecasts that session equally well, but the next session uses different balls again. A belief is
therefore judged without the session's random effects of balls. If its forecasts are then worse, judged by the 90 %
interval, it is not adopted, even if it gains with this session's balls; if they are not worse, it is adopted even
without such a gain.

The belief is then judged by points (truearc.sim.discover.select.simulations): it is refused if hold-out shots that are
aimed and gated with it would have scored fewer points than with the present belief. The mean decides, not its interval:
keeping the present belief costs nothing, and a robot should not be changed for an expected loss.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from msgspec import UNSET, structs

from truearc.errors import InputError
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.discover.decide import Choice, Search, Step, choose, contradicted, decide, gain_interval
from truearc.sim.discover.detect.always_valid import ChangeTest, test_change
from truearc.sim.discover.detect.battery import ALLOWANCE, TERMS, Asked, Judged, ReferenceSession, judge
from truearc.sim.discover.detect.covariates import gather_covariates, gather_factors
from truearc.sim.discover.detect.localization import locate
from truearc.sim.discover.finding import FALSE_ALARM, SIGN_DRAWS, Adoption, FindingRecord
from truearc.sim.discover.report.build_finding import make_finding, silent
from truearc.sim.discover.report.finding_text import say_limits, say_odd
from truearc.sim.discover.report.story import retell
from truearc.sim.discover.select import simulations as worth
from truearc.sim.discover.select.simulations import Freed, Mixed, all_freed, mixed, shares, track_errors
from truearc.sim.discover.select.terms import SURE, by_own_prior
from truearc.sim.infer import launcher
from truearc.sim.infer.belief import Belief, Coefficients, Curve, moved_curves
from truearc.sim.infer.fit import Fit, climb, fit_believed
from truearc.sim.infer.launcher import Launcher, LauncherFit, coefficients_of, covariance_of, scatter_of, stopped
from truearc.sim.infer.likelihood.data import every_column, take_in
from truearc.sim.infer.likelihood.layout import Layout, Measured, is_tracker, lay_out
from truearc.sim.infer.likelihood.score_table import Array, ScoreTable, clustered_error
from truearc.sim.infer.room import ROOM, Room, has_room, open_room
from truearc.sim.physics.catalogue import CURVE, Catalogue, as_catalogue, catalogue
from truearc.sim.physics.term import Term
from truearc.sim.printed import Progress
from truearc.sim.statistics import POINTS_THREE, Z90

# Circumstances that compare a shot with the whole session: with each further shot they would be others.
OF_SESSION = ("age", "battery", "density", "droop")
LAUNCHED = ("exit_speed_m_s", "exit_deg", "exit_spin_rev_s")
Gain = Callable[[ScoreTable, ScoreTable], tuple[float, float]]


@dataclass(frozen=True)
class Investigation:
    """The finding, and the data behind the report's pictures. `steps`: one per effect; all but finding are None where
    the data carry no test. belief: of the earlier session that was started from; search: settings of every step's
    tests; catalogue: of the terms that were tested. choice: what is adopted of the steps, once that is judged.
    threshold: the statistic, in standard deviations, from which a term's test is an alarm. dataset: all shots, in
    order."""

    finding: FindingRecord
    fitted: LauncherFit | None = None
    asked: Asked | None = None
    steps: tuple[Step, ...] = ()
    belief: Belief | None = None
    search: Search | None = None
    catalogue: Catalogue = field(default_factory=catalogue)
    choice: "Choice[Simulation] | None" = None
    threshold: float | None = None
    dataset: Dataset | None = None


def discover(dataset: Dataset, believed: Sequence[str] | None = None, false_alarm: float = FALSE_ALARM, seed: int = 0,
             progress: Progress = lambda done, note: None, belief: Belief | None = None,
             since: Dataset | None = None, measured: Measured | None = None,
             terms: Iterable[Term] | None = None) -> Investigation:
    """Fit the believed terms, test for misfit, locate it, and name the terms that explain it.

    believed: names of terms, the rig's own list when None; gravity always is. belief: of this very rig, from an earlier
    session: its terms and their posterior are the baseline, and whether one of them has changed is tested, too. since:
    that very session; misfit of the belief there is then not a change (truearc.sim.discover.detect.battery).
    measured: external measurements of terms; they bear on which term it is, not on whether anything is missing. terms:
    the hypotheses to test, such as [*catalogue(), HoodFlex()]; the believed ones are among them; those of the belief,
    else the built-in ones and those of installed distributions, when None. The same data and seed give the same answer.
    InputError for an unknown term, too few shots, outcomes without a target, or a measurement of a believed term.
    """
    among = belief.catalogue if terms is None and belief is not None else as_catalogue(terms)
    names = believed_names(dataset, believed if belief is None else tuple(belief.coefficients), among)
    for term in sorted({name.partition(".")[0] for name in measured or {}} & set(names)):
        raise InputError(f"measured: {term} is believed already: put what was measured into rig.toml or the "
                         "coefficients")
    dataset, since = dataset.in_order(), None if since is None else since.in_order()
    model = Launcher.of(dataset, names, among, belief)
    model = replace(model, layout=replace(model.layout, measured=measured or {}))
    if not len(model.data.rows):
        return Investigation(silent(dataset, model.data, names, false_alarm), catalogue=among)
    fitted = fit_believed(model, lambda done, note: progress(0.3 * done, note))
    home = (None if since is None or belief is None or (has_room(belief) and not model.data.filmed) else
            _at_home(since, belief, names, model.layout))
    search = make_search(dataset, false_alarm, seed, home)
    asked, judged = detect(fitted, search, lambda done, note: progress(0.3 + 0.2 * done, note))
    if not asked.tests:
        return Investigation(silent(dataset, model.data, names, false_alarm), catalogue=among)
    place = locate(fitted.scores, asked, judged, false_alarm, search.shots, seed)
    steps: tuple[Step, ...] = ()
    if judged.p_any <= false_alarm:
        steps = decide(fitted, place, search, lambda done, note: progress(0.5 + 0.5 * done, note))
    progress(1.0, "done")
    finding = make_finding(dataset, names, fitted, asked, judged, place, steps, search)
    return Investigation(finding, fitted, asked, steps, belief, search, among,
                         threshold=judged.threshold(TERMS, false_alarm), dataset=dataset)


def with_worth(investigation: Investigation) -> Investigation:
    """Return the same with what is adopted of it, and its finding with its worth in points."""
    if not investigation.steps or investigation.fitted is None:
        return investigation
    choice, found, limits = judge_adoption(investigation), investigation.finding, []
    if new := {name: at for name, at in choice.at_limit.items() if name not in found.data.at_limit}:
        found = structs.replace(found, data=structs.replace(found.data, at_limit=found.data.at_limit | new))
        limits.append(say_limits(new))
    if not choice.trial.empty:
        limits.append(say_odd(launcher.odd_places(choice.trial.scores, investigation.catalogue).values()))
    if choice.points is not None:
        found = structs.replace(found, adoption=structs.replace(choice.points, refused=choice.why or None))
    found = retell(found, investigation.catalogue, limits)
    return replace(investigation, finding=found, choice=choice)


def believed_names(dataset: Dataset, believed: Sequence[str] | None, among: Catalogue) -> tuple[str, ...]:
    """Return the names of the believed terms, gravity first: every flight needs it."""
    given = tuple(dataset.facts.believe.terms if believed is None else believed)
    try:
        among.find(given)
    except InputError as error:
        if believed is not None:
            raise
        raise InputError(f"{dataset.name}: rig.toml: believe.terms: {error}") from error
    return (*among.always, *(name for name in given if name not in among.always))


def make_search(dataset: Dataset, false_alarm: float = FALSE_ALARM, seed: int = 0,
                home: ReferenceSession | None = None) -> Search:
    """Return the covariates and settings of a dataset's tests."""
    return Search(len(dataset.shots), gather_covariates(dataset), gather_factors(dataset.shots), false_alarm, seed,
                  home)


def detect(fitted: LauncherFit, search: Search, progress: Progress) -> tuple[Asked, Judged]:
    """Evaluate all tests of one fit. Without a test nothing is judged."""
    asked = search.ask(fitted)
    judged = judge(asked.scores, [test.family for test in asked.tests], ALLOWANCE, SIGN_DRAWS, search.seed, progress)
    return asked, judged


def _at_home(since: Dataset, belief: Belief, terms: tuple[str, ...], later: Layout) -> ReferenceSession:
    """The belief at its best in the session that it was made from, laid out like the later one."""
    model = Launcher.of(since, terms, later.chain.catalogue, belief, later)
    point = climb(model.shared_only(), model.middle()).point
    return ReferenceSession(Fit(model, point, model.linearise(point)[0]), every_column(since))


def follow_shots(dataset: Dataset, belief: Belief, seed: int = 0) -> ChangeTest:
    """Test the shots of a dataset, in order, for a change since the belief.

    Outcomes and heights at the target count, tracks do not.

    Raises:
        InputError: no shot has an outcome or height with its distance and launch, or the rig has no target.
    """
    evidence = score_since(dataset, belief)
    if evidence is None:
        raise InputError(f"{dataset.name}: no shot has an outcome or a height, with its distance and its launch")
    return test_change(evidence, seed, told_by_session(belief))


def told_by_session(belief: Belief) -> tuple[str, ...]:
    """Return terms that follow comparisons of a shot with its session, which includes later shots: the test excludes
    them."""
    return tuple(term.name for term in belief.catalogue if term.follows in OF_SESSION)


def score_since(dataset: Dataset, belief: Belief) -> ScoreTable | None:
    """Return the score table of a dataset about the belief's mean; None if no shot has information on the height."""
    dataset = before_flight(dataset.in_order())
    names = believed_names(dataset, tuple(belief.coefficients), belief.catalogue)
    data = take_in(dataset, belief.curves, fewest=1)
    if not len(data.marked):
        return None
    model = Launcher(data, lay_out(data, names, None, belief.catalogue, belief))
    return model.linearise(model.believed())[0]


def before_flight(dataset: Dataset) -> Dataset:
    """Return the columns known before each flight, and the outcomes: without tracks, and without measured launches of
    shots whose wheel speeds are known."""
    shots = dataset.shots
    by_robot = np.isfinite(shots.number("motor_ratio")) & np.isfinite(shots.number("hood_deg"))
    for wheel in dataset.facts.launcher.wheel if not by_robot.all() else ():
        by_robot |= np.isfinite(shots.number(f"wheel_{wheel.name}_rad_s")) & np.isfinite(shots.number("hood_deg"))
    numbers = {name: np.where(by_robot, np.nan, column) if name in LAUNCHED else column
               for name, column in shots.numbers.items()}
    return replace(dataset, shots=Shots(shots.shot_id, numbers, shots.texts, shots.source), tracks=None)


def ball_effects(evidence: ScoreTable) -> Int[Array, " k"]:
    """Return the places of the columns of a later session's balls; none without a belief about earlier ones."""
    return np.array([k for k, column in enumerate(evidence.columns) if column.kind == "group" and column.told],
                    dtype=int)


def usual_score(evidence: ScoreTable) -> Float[Array, " n"]:
    """Return the log score [n] of each shot from fits of all columns to the other folds, had the balls been as
    believed."""
    change, balls = evidence.held_out_change(), ball_effects(evidence)
    change[:, balls] = -evidence.point[balls]
    return np.asarray(evidence.log_score + evidence.gain(change))


def usual_gain(before: ScoreTable, after: ScoreTable) -> tuple[float, float]:
    """Return the 90 % interval of a shot's gain in log score from `before` to `after`, with all columns shared."""
    gain = usual_score(after) - usual_score(before)
    error = Z90 * clustered_error(gain, after.rows)
    return float(gain.mean() - error), float(gain.mean() + error)


def make_belief(investigation: Investigation,
                choice: "Choice[Simulation] | None" = None) -> tuple[Belief, dict[str, Any]]:
    """Return (coefficients, scatter and covariance with everything named, and the curve of the rest; provenance).

    Where several names of the last effect could not be told apart, the simulation is chosen that forecasts their
    average (truearc.sim.discover.select.simulations). Where nothing is found, or nothing of it adopted, or even a
    number that was believed before stopped at the end of its range (provenance: at_limit), the belief that was started
    from stays. choice: by `judge_adoption`, which is asked if it is None. ValueError for data that carry no test.
    """
    choice = choice or judge_adoption(investigation)
    taken, among, finding = choice.trial, investigation.catalogue, investigation.finding
    named, free, several = taken.named, taken.free, taken.several
    evidence = taken.scores if taken.room is None else taken.room.fitted.scores
    put_in = {column.name for column in evidence.columns[evidence.first_shared:]}      # not what a rival overtook
    names = [name for step in named[:-1 if several else None] for name in step.refit.names if name in put_in]
    coefficients, curves = _nameless(taken, evidence)
    coefficients |= coefficients_of(evidence, finding.data.believed, among)
    further = named[-1].refit.model.shapes_at(named[-1].refit.point, tuple(names)) if names else {}
    coefficients |= {term: {**coefficients[term], **values} for term, values in further.items()}
    kept, covariance = covariance_of(evidence, among)
    if further:
        covariance = _widened(kept, covariance, named[-1].refit, further)
    provenance = {"method": "discover", "shots": finding.data.shots, "level": finding.data.level,
                  "verdict": finding.verdict,
                  "adopted": [name.partition(".")[0] for name in names] + [one.said for one in free] + _parts(several),
                  "averaged": several is not None,
                  "p_value": finding.mismatch.p_value if finding.mismatch.p_value is not None else "none"}
    why, at_limit = choice.why or taken.why, list(taken.at_limit | stopped(evidence, among))
    if investigation.steps and taken.empty:
        at_limit = at_limit or list(finding.data.at_limit or ())
    refused: dict[str, Any] = {"refused": why} if why else {}
    if at_limit:                      # of what was believed before anything was found
        refused["at_limit"] = at_limit
    if taken.empty and (unfit := contradicted(taken.beaten)):
        refused["unfit"] = unfit
    if investigation.belief is not None and (at_limit or taken.empty):
        # of what is missing its numbers would take a part, and of nothing, what these few shots happened to do
        return investigation.belief, {"kept": True, **refused, **provenance}
    balls = taken.room.balls if taken.room else investigation.belief.balls if investigation.belief else {}
    return (Belief(coefficients, scatter_of(evidence), kept, covariance, curves, among, balls=balls),
            {**refused, **provenance})


def judge_adoption(investigation: Investigation, gain: "Gain | None" = None,
                   threshold: float | None = worth.THRESHOLD) -> "Choice[Simulation]":
    """Choose what is adopted of an investigation's effects.

    gain: bounds of the forecasts' gain where the balls are others, `usual_gain` if None. threshold: of the gate by
    which points are judged; None: they are not. ValueError for data that carry no test.
    """
    if investigation.fitted is None:
        raise ValueError("the data carry no test, so nothing was fitted")
    measures = gain or usual_gain, threshold
    everything, why = _best_flown(investigation)
    if withheld := next((step.withheld for step in everything if step.withheld), ""):
        everything, why = tuple(step for step in everything if not step.unknown), withheld
    named = tuple(step for step in everything if not step.unknown)
    tried = (everything, named) if 0 < len(named) < len(everything) else (everything,) if everything else ()
    trials = (Simulation.of(investigation, steps, *measures) for steps in tried)
    nearest = tuple(replace(step, unknown=False) for step in everything)
    return choose(trials, (lambda: Simulation.of(investigation, nearest, *measures))
                  if threshold is not None and everything and not named else None,
                  Simulation.of(investigation, (), *measures), why)


@dataclass(frozen=True, eq=False)
class Simulation:
    """A simulation that may be adopted, with its measures on hold-out shots (truearc.sim.discover.decide.Adoptable).

    named: effects with a name, each beside those before it; free: curves of unexplained ones; several: the average of
    the last names where they are several; fitted: with it all; why: reason why a curve is not in it. It is measured
    without room, which would help any simulation.
    """

    investigation: Investigation
    named: tuple[Step, ...]
    free: tuple[Freed, ...]
    several: Mixed | None
    fitted: LauncherFit
    why: str
    usual: Gain
    threshold: float | None

    @staticmethod
    def of(investigation: Investigation, steps: tuple[Step, ...], gain: Gain, threshold: float | None) -> "Simulation":
        """Return the simulation with these effects, as far as one can represent them."""
        named, fitted = tuple(step for step in steps if not step.unknown), _fitted(investigation)
        free, why = (all_freed(steps[-1], investigation.search) if fitted.model.data.filmed and steps
                     and steps[-1].unknown and investigation.search is not None else ((), ""))
        if free and (name := free[0].beside):
            naming = steps[-1].naming
            named += (replace(steps[-1], naming=replace(naming, refits={name: naming.refits[name]},
                                                        inclusion={name: 1.0})),)
        elif named:
            named = (*named[:-1], with_own_priors(named))
        several = mixed(named[-1]) if named and not free else None
        found = (replace(free[-1].fitted.without_terms(), scores=free[-1].scores) if free else several.fitted if several
                 else named[-1].refit if named else fitted.without_terms())
        return Simulation(investigation, named, free, several, found, why, gain, threshold)

    @property
    def scores(self) -> ScoreTable:
        return self.fitted.scores

    @cached_property
    def room(self) -> Room | None:
        """The fit with room for what it gets wrong, which a belief made here has; None with tracks, and where the
        belief before says how much there is."""
        if self.investigation.belief is not None or self.fitted.model.data.filmed or self.scores.plane is None:
            return None
        assert self.investigation.dataset is not None
        return open_room(self.fitted, every_column(self.investigation.dataset))

    @property
    def empty(self) -> bool:
        return not self.named and not self.free

    @cached_property
    def at_limit(self) -> dict[str, float]:
        return stopped(self.scores, self.investigation.catalogue)

    @property
    def ends_m(self) -> tuple[float, float] | None:
        fitted, among = _fitted(self.investigation), self.investigation.catalogue
        if not self.named or not fitted.model.data.filmed:
            return None
        return flown_error(fitted.without_terms(), among), flown_error(self.named[-1].refit, among)

    @property
    def beaten(self) -> float | None:
        fitted = _fitted(self.investigation)
        plane = fitted.scores.plane
        if not fitted.model.data.filmed or plane is None or self.scores.plane is None:
            return None
        models = ([fitted.without_terms()], [0.0]) if self.empty else _models(self)
        return worth.shares_beaten(plane.seen, worth.hold_out(*models))

    @property
    def other_balls(self) -> bool:
        return len(ball_effects(_fitted(self.investigation).scores.shared_only())) > 0

    @property
    def gain(self) -> tuple[float, float] | None:
        if self.other_balls:
            return self.usual(_fitted(self.investigation).scores.shared_only(), self.scores)
        fit = self.investigation.finding.fit
        return None if fit is None else gain_interval(fit)

    @property
    def points(self) -> Adoption | None:
        return None if self.threshold is None else judge_points(self.investigation, self, self.threshold)


def _fitted(investigation: Investigation) -> LauncherFit:
    assert investigation.fitted is not None
    return investigation.fitted


def _widened(names: tuple[str, ...], covariance: Float[Array, "p p"], found: LauncherFit,
             further: Coefficients) -> Float[Array, "p p"]:
    """The covariance with the standard deviations of amplitudes that include those of their terms' shape parameters."""
    scale = np.ones(len(names))
    for name, sd in zip(found.names, found.sd, strict=True):
        if name.partition(".")[0] in further and name in names:
            k = names.index(name)
            scale[k] = max(1.0, float(sd) / np.sqrt(covariance[k, k]))
    return covariance * np.outer(scale, scale)


def _parts(several: Mixed | None) -> list[str]:
    """Names with how likely each is, in percent; the rest to 100 is that of no effect."""
    share = {} if several is None else several.share
    return [f"{name.partition('.')[0]} ({value:.0%})" for name, value in share.items()]


def judge_points(investigation: Investigation, taken: Simulation,
                 threshold: float = worth.THRESHOLD) -> Adoption | None:
    """Return points on hold-out shots under the adopted belief, and under the one kept otherwise.

    The latter is the earlier belief unchanged, or else the fit of what was believed. None if nothing was adopted, or no
    target gives points. threshold: of the gate.
    """
    fitted = investigation.fitted
    if fitted is None or taken.empty or fitted.model.data.rig.target is None:
        return None
    if fitted.scores.plane is None or taken.scores.plane is None:
        return None
    seen, rows = fitted.scores.plane.seen, fitted.scores.plane.rows
    old = worth.hold_out([fitted.without_terms()], [0.0]) if investigation.belief is None else (
        worth.as_believed(unfitted(fitted)))
    new = worth.hold_out(*_models(taken))
    before, after = (worth.points_of(seen, one, (old, new), threshold) for one in (old, new))
    scored, best = seen.points(), fitted.model.data.rig.target.worth[1]
    gain = after.worth(best * threshold) - before.worth(best * threshold)
    error = Z90 * clustered_error(gain, fitted.scores.together[rows])
    passed = [float(scored[one.fires].mean()) if one.fires.any() else None for one in (before, after)]
    return Adoption(len(rows), threshold, float(before.aimed.mean()), float(after.aimed.mean()),
                    float(before.fires.mean()), float(after.fires.mean()), passed[0], passed[1], float(gain.mean()),
                    float(gain.mean() - error), float(gain.mean() + error), None,
                    UNSET if best == POINTS_THREE else best)


def unfitted(fitted: LauncherFit) -> LauncherFit:
    """Return the believed simulation as it was before these shots."""
    model = fitted.model.shared_only()
    return Fit(model, model.believed(), model.linearise(model.believed())[0])


def _models(taken: Simulation) -> tuple[list[LauncherFit], list[float]]:
    """The simulations whose average is taken, and the nats of each."""
    if taken.several is None:
        return [taken.fitted], [0.0]
    last = taken.named[-1]
    nothing = float(np.log(sum(candidate.visible for candidate in last.naming.candidates)))
    return ([last.fitted.without_terms(), *(last.naming.refits[name] for name in taken.several.share)],
            [nothing, *(last.naming.nats[name] for name in taken.several.share)])


def _best_flown(investigation: Investigation) -> tuple[tuple[Step, ...], str]:
    """(the steps up to the one whose name makes track ends forecast best, as flown; why not all). All without tracks.
    """
    steps, fitted = investigation.steps, investigation.fitted
    named = [k for k, step in enumerate(steps) if not step.unknown]
    if fitted is None or not fitted.model.data.filmed or not named:
        return steps, ""
    cuts = [_cut(fitted, steps[:k + 1]) for k in named]
    errors_m = [flown_error(cut[-1].refit, investigation.catalogue) for cut in cuts]
    best = int(np.argmin(errors_m))
    if best == len(named) - 1:
        return steps, ""
    last = steps[named[-1]].refit.names[0].partition(".")[0]
    return cuts[best], (
        f"with {last}, but without the tracker's own errors, hold-out tracks end {errors_m[-1]:.3f} m from where they "
        f"are forecast to, {errors_m[best]:.3f} m without it")


def _cut(fitted: LauncherFit, steps: tuple[Step, ...]) -> tuple[Step, ...]:
    """Return the steps, the last of them fitted without shared effects that no step has."""
    last = steps[-1]
    shared = [{column.name for column in one.scores.columns[one.scores.shared]} for one in (fitted, last.fitted)]
    if shared[1] - shared[0] <= {step.naming.leader for step in steps}:
        return steps
    name = last.naming.leader
    alone = fitted.with_terms((name,), last.refit.amplitude)
    naming = replace(last.naming, refits={name: alone}, nats={name: alone.log_evidence}, alike=(),
                     inclusion=last.naming.probability)
    return (*steps[:-1], replace(last, naming=naming, chosen=(name,), base=(), fitted=fitted))


def with_own_priors(named: tuple[Step, ...]) -> Step:
    """Return the last step with refits by the amplitudes' own priors: normal priors shrink large effects too much."""
    last = named[-1]
    parts = {last.naming.leader} if last.naming.probability[last.naming.leader] >= SURE else shares(last.naming)
    beside = [(one.fitted, one.refit) for one in named[:-1] if set(one.refit.names) <= set(last.base)]
    refits = {name: by_own_prior(last.fitted, found, beside) if name in parts else found
              for name, found in last.naming.refits.items()}
    return replace(last, naming=replace(last.naming, refits=refits))


def flown_error(found: LauncherFit, among: Catalogue) -> float:
    """Return the RMS error in m of where tracks end.

    Each shot is flown from a fit to the other folds as an adopted belief is: from its settings alone, and without the
    tracker errors fitted along with it.
    """
    tracker = np.array([is_tracker(column, among) for column in found.scores.columns])
    values, change = found.point.values.copy(), found.scores.held_out_change()
    values[found.model.layout.source[tracker]] = 0.0
    change[:, tracker] = 0.0
    errors_m = track_errors(replace(found, point=replace(found.point, values=values)), change, 0.0)
    return float(np.sqrt(np.mean(np.sum(errors_m**2, axis=1))))


def _nameless(taken: Simulation, evidence: ScoreTable) -> tuple[Coefficients, dict[str, Curve]]:
    """({term: values}, {term: curve}) of the room, and of unexplained effects, believed before and found, as fitted."""
    free, room, belief = taken.free, taken.room, taken.investigation.belief
    curves = {**({} if belief is None else belief.curves), **{one.term: one.curve for one in free},
              **({} if room is None else dict.fromkeys(ROOM, room.curve))}
    before = {} if belief is None else {name: dict(belief.coefficients[name]) for name in belief.curves}
    before |= {} if room is None else ROOM
    points = {column.name.removeprefix(CURVE + "."): float(value) for column, value in zip(
        evidence.columns, evidence.point, strict=True) if column.name.startswith(CURVE + ".")}
    return {**before, **{one.term: dict(one.values) for one in free}}, moved_curves(curves, points)
