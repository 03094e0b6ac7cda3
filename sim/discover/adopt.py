"""An investigation, and the belief made of it: fitted coefficients with every named effect, and their covariance.

A later session's balls may be others, and a fit that may say so attributes much of a change of the robot to them: on
shots of that session it forecasts no worse. But the next session's balls are others again. So a belief is judged with
the session's random effects of balls taken out: one that would then forecast its shots worse, by its 90 % interval, is
not adopted, even if this session's balls gain by it; and one that they do not gain by is, if it is not worse.

Then it is judged by points (truearc.sim.discover.select.simulations): where hold-out shots, aimed and gated by it,
would have scored fewer than by what stays without it, it is refused. The mean decides, not its interval: what is
believed already costs nothing to keep, and a robot is not changed for something that is expected to lose.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from truearc.sim.discover.decide import Choice, choose, contradicted, gain_interval
from truearc.sim.discover.detect.battery import Asked
from truearc.sim.discover.finding import Adoption, FindingRecord
from truearc.sim.discover.select import simulations as worth
from truearc.sim.discover.select.effects import Search, Step
from truearc.sim.discover.select.simulations import Freed, Mixed, all_freed, mixed, shares, track_errors
from truearc.sim.discover.select.terms import SURE, by_own_prior
from truearc.sim.infer.belief import Belief, Coefficients, Curve, moved_curves
from truearc.sim.infer.fit import Fit
from truearc.sim.infer.launcher import LauncherFit, coefficients_of, covariance_of, scatter_of, stopped
from truearc.sim.infer.likelihood.layout import is_tracker
from truearc.sim.infer.likelihood.score_table import Array, ScoreTable, clustered_error
from truearc.sim.physics.catalogue import Catalogue, catalogue
from truearc.sim.physics.nonparametric import CURVE
from truearc.sim.statistics import POINTS_THREE, Z90

Gain = Callable[[ScoreTable, ScoreTable], tuple[float, float]]


@dataclass(frozen=True)
class Investigation:
    """The finding, and the data behind the report's pictures. `steps`: one per effect; all but finding are None where
    the data carry no test. belief: of the earlier session that was started from; search: settings of every step's
    tests; catalogue: of the terms that were tested; ranges: of the shots' settings; launcher: ball and wheels.
    choice: what is adopted of the steps, once that is judged. threshold: the statistic, in standard deviations, from
    which a term's test is an alarm."""

    finding: FindingRecord
    fitted: LauncherFit | None = None
    asked: Asked | None = None
    steps: tuple[Step, ...] = ()
    belief: Belief | None = None
    search: Search | None = None
    catalogue: Catalogue = field(default_factory=catalogue)
    ranges: dict[str, list[float]] = field(default_factory=dict)
    launcher: dict[str, float] = field(default_factory=dict)
    choice: "Choice[Simulation] | None" = None
    threshold: float | None = None


def ball_effects(evidence: ScoreTable) -> Int[Array, " k"]:
    """Places of the columns of a later session's balls; none where no belief about earlier ones was given."""
    return np.array([k for k, column in enumerate(evidence.columns) if column.kind == "group" and column.told],
                    dtype=int)


def usual_score(evidence: ScoreTable) -> Float[Array, " n"]:
    """Log score [n] of each shot by fits of all columns to the other folds, had the balls been as believed."""
    change, balls = evidence.held_out_change(), ball_effects(evidence)
    change[:, balls] = -evidence.point[balls]
    return np.asarray(evidence.log_score + evidence.gain(change))


def usual_gain(before: ScoreTable, after: ScoreTable) -> tuple[float, float]:
    """90 % interval of the log score that a shot gains by `after` in place of `before`, columns all shared in both."""
    gain = usual_score(after) - usual_score(before)
    error = Z90 * clustered_error(gain, after.rows)
    return float(gain.mean() - error), float(gain.mean() + error)


def make_belief(investigation: Investigation,
                choice: "Choice[Simulation] | None" = None) -> tuple[Belief, dict[str, Any]]:
    """(coefficients, scatter and covariance with all that was named, and the curve of the rest; provenance).

    Where several names of the last effect could not be told apart, the simulation is chosen that forecasts their
    average (truearc.sim.discover.select.simulations). Where nothing is found, or nothing of it adopted, or even a
    number that was believed before stopped at the end of its range (provenance: at_limit), the belief that was started
    from stays. choice: by `judge_adoption`, which is asked if it is None. ValueError for data that carry no test.
    """
    choice = choice or judge_adoption(investigation)
    taken, among, finding = choice.trial, investigation.catalogue, investigation.finding
    named, free, several, evidence = taken.named, taken.free, taken.several, taken.scores
    put_in = {column.name for column in evidence.columns[evidence.first_shared:]}      # not what a rival overtook
    names = [name for step in named[:-1 if several else None] for name in step.refit.names if name in put_in]
    coefficients, curves = _nameless(evidence, free, investigation.belief)
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
    why, at_limit = choice.why or taken.why, list(taken.at_limit)
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
    return Belief(coefficients, scatter_of(evidence), kept, covariance, curves, among), {**refused, **provenance}


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
    the last names where they are several; evidence: of it all; why: reason why a curve is not in it.
    """

    investigation: Investigation
    named: tuple[Step, ...]
    free: tuple[Freed, ...]
    several: Mixed | None
    scores: ScoreTable
    why: str
    usual: Gain
    threshold: float | None

    @staticmethod
    def of(investigation: Investigation, steps: tuple[Step, ...], gain: Gain, threshold: float | None) -> "Simulation":
        """With these effects in it, as far as a simulation can hold them."""
        named = tuple(step for step in steps if not step.unknown)
        free, why = (all_freed(steps[-1], investigation.search)
                     if steps and steps[-1].unknown and investigation.search is not None else ((), ""))
        if free and (name := free[0].beside):
            naming = steps[-1].naming
            named += (replace(steps[-1], naming=replace(naming, refits={name: naming.refits[name]},
                                                        inclusion={name: 1.0})),)
        elif named:
            named = (*named[:-1], with_own_priors(named))
        several = mixed(named[-1]) if named and not free else None
        evidence = (free[-1].scores if free else several.scores if several else named[-1].refit.scores if named
                    else _fitted(investigation).scores.shared_only())
        return Simulation(investigation, named, free, several, evidence, why, gain, threshold)

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
    """Points on hold-out shots by what was taken, and by what stays without it: the belief that was started from, as it
    is, else the fit of what was believed. None where nothing was taken, or no target tells points. threshold: of the
    gate."""
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
    scored, held = worth.scored_points(seen), POINTS_THREE * threshold
    gain = after.worth(held) - before.worth(held)
    error = Z90 * clustered_error(gain, fitted.scores.together[rows])
    passed = [float(scored[one.fires].mean()) if one.fires.any() else None for one in (before, after)]
    return Adoption(len(rows), threshold, float(before.aimed.mean()), float(after.aimed.mean()),
                    float(before.fires.mean()), float(after.fires.mean()), passed[0], passed[1], float(gain.mean()),
                    float(gain.mean() - error), float(gain.mean() + error), None)


def unfitted(fitted: LauncherFit) -> LauncherFit:
    """The believed simulation as it was before these shots."""
    model = fitted.model.shared_only()
    return Fit(model, model.believed(), model.linearise(model.believed())[0])


def _models(taken: Simulation) -> tuple[list[LauncherFit], list[float]]:
    """The simulations whose average is taken, and the nats of each."""
    if taken.free:
        return [replace(taken.free[-1].fitted.without_terms(), scores=taken.scores)], [0.0]
    last = taken.named[-1]
    if taken.several is None:
        return [last.refit], [0.0]
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
    """The last step, its refits by the amplitudes' own priors: by normal ones large effects come out too small."""
    last = named[-1]
    parts = {last.naming.leader} if last.naming.probability[last.naming.leader] >= SURE else shares(last.naming)
    beside = [(one.fitted, one.refit) for one in named[:-1] if set(one.refit.names) <= set(last.base)]
    refits = {name: by_own_prior(last.fitted, found, beside) if name in parts else found
              for name, found in last.naming.refits.items()}
    return replace(last, naming=replace(last.naming, refits=refits))


def flown_error(found: LauncherFit, among: Catalogue) -> float:
    """RMS error in m of where tracks end, each shot by a fit to the other folds, flown as an adopted belief is: from
    its settings alone, and without the errors of the tracker that were fitted beside it."""
    tracker = np.array([is_tracker(column, among) for column in found.scores.columns])
    values, change = found.point.values.copy(), found.scores.held_out_change()
    values[found.model.layout.source[tracker]] = 0.0
    change[:, tracker] = 0.0
    errors_m = track_errors(replace(found, point=replace(found.point, values=values)), change, 0.0)
    return float(np.sqrt(np.mean(np.sum(errors_m**2, axis=1))))


def _nameless(evidence: ScoreTable, free: tuple[Freed, ...],
              belief: Belief | None) -> tuple[Coefficients, dict[str, Curve]]:
    """({term: values}, {term: curve}) of unexplained effects, those believed before and those found, as fitted."""
    curves = {**({} if belief is None else belief.curves), **{one.term: one.curve for one in free}}
    before = {} if belief is None else {name: dict(belief.coefficients[name]) for name in belief.curves}
    points = {column.name.removeprefix(CURVE + "."): float(value) for column, value in zip(
        evidence.columns, evidence.point, strict=True) if column.name.startswith(CURVE + ".")}
    return {**before, **{one.term: dict(one.values) for one in free}}, moved_curves(curves, points)
