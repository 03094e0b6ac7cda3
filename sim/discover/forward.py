"""Effects one after another: name one, put it in, ask again; at most three. A free curve may outrun the first name only
because more than one thing is missing: then further names go on probation, and stand if together they beat it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim.discover.ask import ALLOWANCE, Asked, Clusters, ask_everything
from sim.discover.believed import Fitted
from sim.discover.covariates import Covariate, Factor
from sim.discover.evidence import Array
from sim.discover.locate import Place, locate
from sim.discover.name import Naming, name_terms
from sim.discover.refit import Refit, clustered_error, refit, unseen_score, without
from sim.discover.statistics import Judged, judge
from sim.discover.step import CLEARLY, Step, averaged, make_step, promote, worth

Progress = Callable[[float, str], None]
MOST = 3
DRAWS = 999                           # after the first step, whose probability is the one that is promised


@dataclass(frozen=True)
class Search:
    """What every step of one search asks with."""

    clusters: Clusters
    covariates: tuple[Covariate, ...]
    factors: tuple[Factor, ...]
    false_alarm: float
    seed: int


def go_forward(fitted: Fitted, place: Place | None, search: Search, progress: Progress) -> tuple[Step, ...]:
    """Name the effect that was found, and go on while anything is left beyond chance."""
    steps = _chain(fitted, place, search, lambda done, note: progress(0.8 * done, note))
    steps = without_outrun(steps)
    steps = _while_paying(steps)
    return _together(fitted, steps, search, lambda done, note: progress(0.8 + 0.2 * done, note))


def _chain(fitted: Fitted, place: Place | None, search: Search, progress: Progress) -> tuple[Step, ...]:
    """Up to MOST steps, until nothing is left, or what is left has no name."""
    steps: list[Step] = []
    for number in range(MOST):
        span = (number / MOST, 0.8 / MOST)
        base = tuple(step.naming.leader for step in steps)
        steps.append(make_step(fitted, search.clusters, place, base, search.seed,
                               lambda done, note, span=span: progress(span[0] + done * span[1], note)))
        if (steps[-1].unknown and not steps[-1].outrun) or number == MOST - 1:
            break
        fitted = promote(fitted, steps[-1].refit)
        asked = ask_everything(fitted.evidence, search.covariates, search.factors, search.clusters, search.seed)
        if not asked.tests:
            break
        judged = _judge(asked, search.seed)
        if judged.p_any > search.false_alarm:
            break
        place = locate(fitted.evidence, asked, judged, search.false_alarm, search.clusters, search.seed)
    return tuple(steps)


def without_outrun(steps: tuple[Step, ...]) -> tuple[Step, ...]:
    """Names that were outrun stand where names after them make up for it on unseen shots, by more than chance and to
    more than the curve had; else the first that was outrun is without a name, and ends the chain."""
    for number, step in enumerate(steps):
        if not step.outrun:
            continue
        last = max((k for k in range(number, len(steps)) if not steps[k].unknown), default=number)
        if last == number or not _makes_up(step, steps[last]):
            return steps[:number + 1]
        redeemed = tuple(replace(one, unknown=False, outrun=False, rival=_left_to(one, steps[last]))
                         for one in steps[number:last])
        return without_outrun((*steps[:number], *redeemed, *steps[last:]))
    return steps


def _makes_up(step: Step, last: Step) -> bool:
    gain = last.after - step.after
    clear = gain.mean() > CLEARLY * clustered_error(gain, step.fitted.together)
    return bool(clear and step.free is not None and last.after.sum() >= step.free.sum())


def _left_to(step: Step, last: Step) -> float | None:
    """Nats that the step's free curve has over all names together."""
    return None if step.free is None else worth(step.free - last.after, step.fitted)


def _while_paying(steps: tuple[Step, ...]) -> tuple[Step, ...]:
    """Up to the last effect with which unseen shots are clearly better foretold than with the first alone, or with
    those up to the one before: chance finds something more than at first."""
    kept = steps[:1]
    for number in range(1, len(steps)):
        step, before = steps[number], kept[-1]
        gain = (step.free if step.unknown and step.free is not None else step.after) - before.after
        if gain.mean() > CLEARLY * clustered_error(gain, step.fitted.together):
            kept = steps[:number + 1]
    return kept


def _together(fitted: Fitted, steps: tuple[Step, ...], search: Search, progress: Progress) -> tuple[Step, ...]:
    """Each name once more, with the others in: what the first took upon itself before there was a second is undone, a
    name that has nothing left to do goes, and each has its rivals judged beside the same company."""
    named = [step for step in steps if not step.unknown]
    if len(named) < 2:
        return steps
    size = _still_at_work(fitted, refit(fitted, *_company(named)))
    told: list[Step] = []
    for number, name in enumerate(tuple(size)):
        others = tuple(one for one in size if one != name)
        base = promote(fitted, refit(fitted, others, np.array([size[one] for one in others]))) if others else fitted
        naming = name_terms(base, lambda done, note, number=number: progress((number + done) / len(named), note),
                            {name: size.pop(name)})
        size[naming.leader] = float(naming.refits[naming.leader].amplitude[0])
        told.append(_retold(named[number], naming, base, search.clusters))
    return (*told, *(step for step in steps if step.unknown))


def _company(named: Sequence[Step]) -> tuple[tuple[str, ...], Array]:
    """(names, amplitudes) of all steps."""
    return (tuple(step.naming.leader for step in named),
            np.array([float(step.refit.amplitude[0]) for step in named]))


def _still_at_work(fitted: Fitted, whole: Refit) -> dict[str, float]:
    """{name: amplitude} of these names less those without which the data are likelier, most missed first."""
    while len(whole.names) > 1:
        fewer = [_less(fitted, whole, name) for name in whole.names]
        best = max(fewer, key=lambda one: one.log_evidence)
        if best.log_evidence <= whole.log_evidence:
            missed = sorted(range(len(fewer)), key=lambda k: fewer[k].log_evidence)
            return {whole.names[k]: float(whole.amplitude[k]) for k in missed}
        whole = best
    return {whole.names[0]: float(whole.amplitude[0])}


def _less(fitted: Fitted, whole: Refit, name: str) -> Refit:
    kept = [k for k, one in enumerate(whole.names) if one != name]
    return refit(fitted, tuple(whole.names[k] for k in kept), whole.amplitude[kept])


def _retold(step: Step, naming: Naming, base: Fitted, clusters: Clusters) -> Step:
    """The step with this name, among these others."""
    before = unseen_score(without(base.evidence), clusters)
    scores = {name: unseen_score(one.evidence, clusters) for name, one in naming.refits.items()}
    average = averaged(naming, before, scores, clusters.label[base.evidence.rows])
    place = step.place
    if place is not None:
        place = replace(place, test=replace(place.test, column=base.evidence.index(place.column.name)))
    return replace(step, naming=naming, place=place, before=before, after=scores[naming.leader], average=average,
                   fitted=base)


def _judge(asked: Asked, seed: int) -> Judged:
    return judge(asked.scores, [test.family for test in asked.tests], ALLOWANCE, DRAWS, seed, lambda done, note: None)
