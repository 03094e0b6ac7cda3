"""Forward selection: name one effect, put it in, test again; three effects at most.

A free curve may do better than the first name only because more than one thing is missing: then further names go on
probation, and stand if together they beat it; where neither of two names alone explains the misfit, pairs are tried.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from truearc.sim.discover.detect.covariates import Covariate, Factor
from truearc.sim.discover.detect.localization import Place, locate
from truearc.sim.discover.detect.reference_session import ReferenceSession
from truearc.sim.discover.detect.score_test import Judged, judge
from truearc.sim.discover.detect.test_battery import ALLOWANCE, Asked, ask_everything
from truearc.sim.discover.model.baseline_fit import BaselineFit, part_of
from truearc.sim.discover.model.score_table import Array
from truearc.sim.discover.select.refit import Refit, clustered_error, promote, refit, unseen_score
from truearc.sim.discover.select.selection_step import CLEARLY, Step, clearly, make_step, unseen_scores, worth
from truearc.sim.discover.select.term_ranking import Naming, is_possible, name_terms, one_step, tame
from truearc.sim.progress import Progress

MOST = 3
DRAWS = 999                           # after the first step, whose probability is the one that is promised
FIRSTS = 4                            # of the likeliest names, each put in to see which other one goes with it
WITHIN = 6.0                          # nats of the likeliest pair by one step, beyond which none is refitted
MOST_PAIRS = 6                        # refitted


@dataclass(frozen=True)
class Search:
    """The data and settings of all tests of one search. shots: how many the dataset has."""

    shots: int
    covariates: tuple[Covariate, ...]
    factors: tuple[Factor, ...]
    false_alarm: float
    seed: int
    home: ReferenceSession | None = None          # the session since which changes are looked for

    def ask(self, fitted: BaselineFit) -> Asked:
        """All tests of the fit, the misfit of the reference session subtracted."""
        return ask_everything(fitted.evidence, self.covariates, self.factors, self.shots, self.seed,
                              self.beside(fitted))

    def left(self, fitted: BaselineFit) -> tuple[Asked, Judged] | None:
        """All tests, judged, if anything is left beside the effects found already."""
        asked = self.ask(fitted)
        judged = judge_left(asked, self.seed) if asked.tests else None
        return None if judged is None or judged.p_any > self.false_alarm else (asked, judged)

    def step(self, fitted: BaselineFit, place: Place | None, base: tuple[str, ...], progress: Progress) -> Step:
        """Name the effect that is left in `fitted`, after those of `base`."""
        return make_step(fitted, self.shots, place, base, self.seed, progress, self.beside(fitted))

    def beside(self, fitted: BaselineFit) -> ReferenceSession | None:
        """Home with what `fitted` has been given, fitted there, too."""
        return None if self.home is None else self.home.among(fitted)


def go_forward(fitted: BaselineFit, place: Place | None, search: Search, progress: Progress) -> tuple[Step, ...]:
    """Name the effect that was found, and go on while anything is left beyond chance."""
    steps = _chain(fitted, place, search, (), lambda done, note: progress(0.7 * done, note))
    steps = _while_paying(without_outrun(steps))
    size = {step.naming.leader: float(step.refit.amplitude[0]) for step in steps if not step.unknown}
    if steps[0].outrun:
        steps, size = in_company(fitted, steps[0], search)
    elif len(size) > 1:
        steps, size = or_likelier_pair(fitted, steps, size, search)
    return _together(fitted, steps, size, search, lambda done, note: progress(0.8 + 0.2 * done, note))


def _chain(fitted: BaselineFit, place: Place | None, search: Search, named: tuple[str, ...],
           progress: Progress) -> tuple[Step, ...]:
    """Up to MOST steps with those `named` before, until nothing is left, or no term explains what is left."""
    steps: list[Step] = []
    for number in range(len(named), MOST):
        base = (*named, *(step.naming.leader for step in steps))
        steps.append(search.step(fitted, place, base, part_of(progress, number / MOST, 0.8 / MOST)))
        if (steps[-1].unknown and not steps[-1].outrun) or number == MOST - 1:
            break
        fitted = promote(fitted, steps[-1].refit)
        left, place = _what_is_left(fitted, search)
        if not left:
            break
    return tuple(steps)


def _what_is_left(fitted: BaselineFit, search: Search) -> tuple[bool, Place | None]:
    """(whether anything is, where)."""
    left = search.left(fitted)
    if left is None:
        return False, None
    return True, locate(fitted.evidence, *left, search.false_alarm, search.shots, search.seed)


def in_company(fitted: BaselineFit, step: Step, search: Search) -> tuple[tuple[Step, ...], dict[str, float]]:
    """(the step, {}) whose name did worse than a free curve; or, where they catch up with the curve, the best pair of
    names and what may follow it, with their amplitudes."""
    pair = best_pair(fitted, step.naming)
    if pair is None:
        return (step,), {}
    steps, size, last = _from_pair(fitted, step, pair, search)
    if not _makes_up(step, last):
        return (step,), {}
    left = _left_to(step, last)
    return (*(replace(one, rival=left) for one in steps[:2]), *steps[2:]), size


def or_likelier_pair(fitted: BaselineFit, steps: tuple[Step, ...], size: dict[str, float],
                     search: Search) -> tuple[tuple[Step, ...], dict[str, float]]:
    """(steps, names with amplitudes) as they are, or from the best pair where that makes the data likelier: a first
    name that stood for two others leads on to wrong ones."""
    pair = best_pair(fitted, steps[0].naming)
    if pair is None or pair.log_evidence <= refit(fitted, tuple(size), np.array(list(size.values()))).log_evidence:
        return steps, size
    return _from_pair(fitted, steps[0], pair, search)[:2]


def _from_pair(fitted: BaselineFit, step: Step, pair: Refit,
               search: Search) -> tuple[tuple[Step, ...], dict[str, float], Float[Array, " n"]]:
    """(steps of the two names and of what may follow them, all names with amplitudes, log scores of unseen shots by
    all names); `step` is what was found before any term was named."""
    both, whole = unseen_score(pair.evidence), promote(fitted, pair)
    left, place = _what_is_left(whole, search)
    third = _chain(whole, place, search, pair.names, lambda done, note: None) if left else ()
    third = tuple(one for one in third if _pays(one, both))
    named = [one for one in third if not one.unknown]
    last = named[-1].after if named else both
    first = replace(step, unknown=False, outrun=False)
    second = replace(first, base=pair.names[:1], place=None)
    size = dict(zip(pair.names, map(float, pair.amplitude), strict=True))
    size |= {one.naming.leader: float(one.refit.amplitude[0]) for one in named}
    return (first, second, *third), size, last


def best_pair(fitted: BaselineFit, naming: Naming) -> Refit | None:
    """The likeliest pair, refitted; None where no second name is visible beside a first, or no pair possible."""
    guesses: dict[frozenset[str], tuple[float, tuple[str, str], tuple[float, float]]] = {}
    for first in sorted(naming.refits, key=lambda name: -naming.nats[name])[:FIRSTS]:
        alone = naming.refits[first]
        base = promote(fitted, alone)
        for second in one_step(base.evidence)[0]:
            both, nats = frozenset((first, second.name)), naming.nats[first] + second.nats
            if second.visible and nats > guesses.get(both, (-np.inf,))[0]:
                guesses[both] = nats, (first, second.name), (float(alone.amplitude[0]), tame(second, base.evidence))
    ranked = sorted(guesses.values(), reverse=True)[:MOST_PAIRS]
    pairs = [refit(fitted, names, np.array(start)) for nats, names, start in ranked if nats > ranked[0][0] - WITHIN]
    usual = {column.name: column.usual for column in fitted.evidence.columns[:fitted.evidence.first_shared]}
    possible = [pair for pair in pairs if is_possible(pair, *(usual[name] for name in pair.names))]
    return max(possible, key=lambda pair: pair.log_evidence, default=None)


def without_outrun(steps: tuple[Step, ...]) -> tuple[Step, ...]:
    """Names that a free curve beat stand where names after them make up for it on unseen shots; else the first of them
    is unexplained, and ends the chain."""
    for number, step in enumerate(steps):
        if not step.outrun:
            continue
        last = max((k for k in range(number, len(steps)) if not steps[k].unknown), default=number)
        if last == number or not _makes_up(step, steps[last].after):
            return steps[:number + 1]
        redeemed = tuple(replace(one, unknown=False, outrun=False, rival=_left_to(one, steps[last].after))
                         for one in steps[number:last])
        return without_outrun((*steps[:number], *redeemed, *steps[last:]))
    return steps


def _makes_up(step: Step, after: Float[Array, " n"]) -> bool:
    """Whether log scores [n] of several names are better than the step's name's by more than chance, and its free
    curve's not clearly better than theirs."""
    gain = after - step.after
    pays = gain.mean() > CLEARLY * clustered_error(gain, step.fitted.together)
    return bool(pays) and step.free is not None and not clearly(step.free - after, step.fitted)


def _left_to(step: Step, after: Float[Array, " n"]) -> float | None:
    """Nats that the step's free curve has over all names together."""
    return None if step.free is None else worth(step.free - after, step.fitted)


def _while_paying(steps: tuple[Step, ...]) -> tuple[Step, ...]:
    """Up to the last effect with which unseen shots are clearly better forecast than by those kept before it: chance
    finds something more easily than at first."""
    kept = steps[:1]
    for number in range(1, len(steps)):
        if _pays(steps[number], kept[-1].after):
            kept = steps[:number + 1]
    return kept


def _pays(step: Step, before: Float[Array, " n"]) -> bool:
    gain = (step.free if step.unknown and step.free is not None else step.after) - before
    return bool(gain.mean() > CLEARLY * clustered_error(gain, step.fitted.together))


def _together(fitted: BaselineFit, steps: tuple[Step, ...], size: dict[str, float], search: Search,
              progress: Progress) -> tuple[Step, ...]:
    """Each name once more, with the others in: what the first took upon itself before there was a second is undone, a
    name that has nothing left to do goes, and each has its rivals judged beside the same company.

    size: {name: amplitude} of the steps that have names.
    """
    if len(size) < 2:
        return steps
    named = [step for step in steps if not step.unknown]
    size = _still_at_work(fitted, refit(fitted, tuple(size), np.array(list(size.values()))))
    again: list[Step] = []
    for number, name in enumerate(tuple(size)):
        others = tuple(one for one in size if one != name)
        base = promote(fitted, refit(fitted, others, np.array([size[one] for one in others]))) if others else fitted
        naming = name_terms(base, part_of(progress, number / len(named), 1.0 / len(named)), {name: size.pop(name)})
        size[naming.leader] = float(naming.refits[naming.leader].amplitude[0])
        own = next((one for one in named if one.naming.leader == name), named[number])
        again.append(_renamed(own, naming, base))
    rest = any(step.unknown for step in steps)
    return (*again, *(_rest(fitted, size, again[-1].after, search) if rest else ()))


def _rest(fitted: BaselineFit, size: dict[str, float], after: Float[Array, " n"], search: Search) -> tuple[Step, ...]:
    """The step, if any, of the misfit beside the names as they are now, some of which may have changed.

    after [n]: log scores of unseen shots by these names.
    """
    if len(size) == MOST:
        return ()
    whole = promote(fitted, refit(fitted, tuple(size), np.array(list(size.values()))))
    left, place = _what_is_left(whole, search)
    if not left:
        return ()
    step = search.step(whole, place, tuple(size), lambda done, note: None)
    return (step,) if _pays(step, after) else ()


def _still_at_work(fitted: BaselineFit, whole: Refit) -> dict[str, float]:
    """{name: amplitude} of these names less those without which the data are likelier, most missed first."""
    while len(whole.names) > 1:
        fewer = [_less(fitted, whole, name) for name in whole.names]
        best = max(fewer, key=lambda one: one.log_evidence)
        if best.log_evidence <= whole.log_evidence:
            missed = sorted(range(len(fewer)), key=lambda k: fewer[k].log_evidence)
            return {whole.names[k]: float(whole.amplitude[k]) for k in missed}
        whole = best
    return {whole.names[0]: float(whole.amplitude[0])}


def _less(fitted: BaselineFit, whole: Refit, name: str) -> Refit:
    kept = [k for k, one in enumerate(whole.names) if one != name]
    return refit(fitted, tuple(whole.names[k] for k in kept), whole.amplitude[kept])


def _renamed(step: Step, naming: Naming, base: BaselineFit) -> Step:
    """The step with this name, among these others."""
    before, after, average = unseen_scores(naming, base)
    place = step.place
    if place is not None:
        place = replace(place, test=replace(place.test, column=base.evidence.index(place.column.name)))
    return replace(step, naming=naming, place=place, before=before, after=after, average=average, fitted=base)


def judge_left(asked: Asked, seed: int) -> Judged:
    """All tests of what is left beside what was found already."""
    return judge(asked.scores, [test.family for test in asked.tests], ALLOWANCE, DRAWS, seed, lambda done, note: None)
