"""Name what is missing by the posterior over hypotheses (truearc.sim.discover.select.posterior); three effects at most.

A second thing is named, or said to be unexplained, where the posterior has it and the calibrated test still finds
something beside the first.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp

from truearc.sim.discover.detect.covariates import Covariate, Factor
from truearc.sim.discover.detect.localization import Place, locate
from truearc.sim.discover.detect.reference_session import ReferenceSession
from truearc.sim.discover.detect.score_test import Judged, judge
from truearc.sim.discover.detect.test_battery import ALLOWANCE, Asked, ask_everything
from truearc.sim.discover.select.posterior import Hypotheses, Hypothesis, weigh
from truearc.sim.discover.select.refit import Refit, promote, refit
from truearc.sim.discover.select.term_ranking import NEVER, Naming, name_terms
from truearc.sim.infer.baseline_fit import BaselineFit
from truearc.sim.infer.held_out import clustered_error, folds_of, unseen_score, without
from truearc.sim.infer.likelihood.score_table import Array, Column
from truearc.sim.printed import Progress, part_of

DRAWS = 999                           # after the first step, whose probability is the one that is promised
SURE = 0.9                            # probability of one name, or that a set holds of what is explained
TWIN = 0.5                            # of a name's probability, that what hardly differs from it must have
ANY = 0.01                            # probability of names, below which they do not stand for what is unexplained
UNKNOWN = 0.5                         # probability of something unexplained, from which that is the verdict
FARTHEST = 4.0                        # standard deviations of a prior, in which a term's number is believable
CLEARLY = 2.0                         # standard errors by which a free curve is better on unseen shots
Each = Float[Array, " n"]             # a number of each shot


@dataclass(frozen=True)
class Step:
    """One effect. `before`, `after`, `average`, `free` [n]: log scores of unseen shots without it, with the leading
    name, with all names as far as they are likely, with the free curve. Other named effects are in `fitted`.

    unknown: it is more likely unexplained than any term, or no term explains it.
    """

    naming: Naming
    place: Place | None
    before: Each
    after: Each
    average: Each
    free: Each | None
    unknown: bool
    base: tuple[str, ...]             # names put in before
    fitted: BaselineFit               # without this effect
    unexplained: float = 0.0          # probability of a change that no term explains, alone or beside one
    change: Hypothesis | None = None  # the likeliest such change, with the name that it stands beside

    @property
    def refit(self) -> Refit:
        return self.naming.refits[self.naming.leader]

    @property
    def column(self) -> Column:
        """Of the leading name, in `fitted`."""
        return self.fitted.evidence.columns[self.fitted.evidence.index(self.naming.leader)]


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
        home = None if self.home is None else self.home.among(fitted)
        return ask_everything(fitted.evidence, self.covariates, self.factors, self.shots, self.seed, home)

    def left(self, fitted: BaselineFit) -> tuple[Asked, Judged] | None:
        """All tests, judged, if anything is left beside the effects found already."""
        asked = self.ask(fitted)
        judged = judge_left(asked, self.seed) if asked.tests else None
        return None if judged is None or judged.p_any > self.false_alarm else (asked, judged)

    def weigh(self, fitted: BaselineFit, progress: Progress) -> tuple[Naming, Hypotheses]:
        """Every term alone, with its probability among all that may be missing in the fit."""
        naming = name_terms(fitted, lambda done, note: progress(0.5 * done, note))
        posterior = weigh(fitted, naming, self.covariates, self.factors, self.home)
        progress(1.0, "weighed")
        return with_probabilities(naming, posterior), posterior

    def where(self, fitted: BaselineFit, left: tuple[Asked, Judged]) -> Place | None:
        """Where the rest is."""
        return locate(fitted.evidence, *left, self.false_alarm, self.shots, self.seed)


def name_effects(fitted: BaselineFit, place: Place | None, search: Search, progress: Progress) -> tuple[Step, ...]:
    """Name what was found, and what else is missing beside it; at least one step."""
    naming, posterior = search.weigh(fitted, part_of(progress, 0.0, 0.5))
    whole = _step(naming, place, (), fitted, posterior)
    varies = posterior.share("varies") >= UNKNOWN
    if out_of_nature(whole.refit, fitted):
        return (replace(whole, unknown=True),)
    if _says_nothing(naming) or not (varies or posterior.holds_more()):
        return (whole,)
    first, both = replace(whole, unknown=False), not varies and posterior.share("both") > posterior.share("two")
    if both:                          # what is unexplained is another effect, beside which names count
        first = replace(first, naming=with_probabilities(naming, posterior, beside=True),
                        unexplained=posterior.share("unexplained"))
    named = promote(fitted, first.refit)
    left = search.left(named)
    if left is None:                  # nothing is found beside it, so names count without that
        alone = posterior.share("both") >= UNKNOWN and 1.0 - posterior.unexplained() > ANY
        return (replace(first if both else whole, unknown=False) if alone else whole,)
    if varies or both:
        change = posterior.likeliest_change(first.naming.leader)
        if both and place is not None and change is not None and _direction(fitted, change) == first.column.direction:
            return (replace(whole, unknown=True),)         # the name stands for the rest, too
        return (first, *_rest(named, search.where(named, left), first.naming.leader, change))
    pair = posterior.likeliest_pair()
    if pair is None:
        return (whole,)
    if out_of_nature(pair, first.refit):
        return (first, *_rest(named, search.where(named, left), first.naming.leader, None))
    return _two_and_rest(fitted, first, pair, search, part_of(progress, 0.5, 0.5))


def out_of_nature(found: Refit, before: Refit | BaselineFit) -> bool:
    """Whether the fit moves a number that was there before to FARTHEST standard deviations from what the catalogue
    knows: then the term that was added stands for something else. Numbers of an earlier session may change."""
    known = {column.name for column in before.layout.columns[before.layout.first_shared:]}
    return bool((_strange(found) - _strange(before)) & known)


def _strange(fit: Refit | BaselineFit) -> set[str]:
    layout, first = fit.layout, fit.layout.first_shared
    sd = np.sqrt(np.diag(np.linalg.inv(layout.precision)))
    far = np.abs(fit.evidence.point[first:] - layout.centre) > FARTHEST * sd
    return {one.name for one, out in zip(layout.columns[first:], far & layout.in_slot[first:], strict=True)
            if out and not one.told}


def _direction(fitted: BaselineFit, change: Hypothesis) -> str:
    assert change.family is not None
    return fitted.evidence.columns[fitted.evidence.index(change.family.column)].direction


def _rest(named: BaselineFit, place: Place | None, name: str, change: Hypothesis | None) -> tuple[Step, ...]:
    """The unexplained step beside a name, where it can be placed."""
    if place is None:
        return ()
    naming = name_terms(named, lambda done, note: None)
    return (replace(_unnamed(naming, place, (name,), named), unknown=True,
                    change=change and replace(change, names=())),)


def _two_and_rest(fitted: BaselineFit, first: Step, pair: Refit, search: Search,
                  progress: Progress) -> tuple[Step, ...]:
    """A step for each of two names, its rivals judged beside the other, and one for what is left beside both.

    The second is the likeliest beside the first once it is truly refitted, which the pair's closed form only guesses.
    """
    lead = 0 if pair.names[0] == first.naming.leader else 1
    beside = promote(fitted, refit(fitted, (pair.names[lead],), pair.amplitude[[lead]]))
    second = name_terms(beside, part_of(progress, 0.0, 0.3), {pair.names[1 - lead]: float(pair.amplitude[1 - lead])})
    other = second.refits[second.leader]
    base = promote(fitted, refit(fitted, (second.leader,), other.amplitude))
    naming = name_terms(base, part_of(progress, 0.3, 0.3), {pair.names[lead]: float(pair.amplitude[lead])})
    steps = (_unnamed(naming, first.place, (), base), _unnamed(second, None, (pair.names[lead],), beside))
    names = (naming.leader, second.leader)
    both = promote(fitted, refit(fitted, names, np.array([naming.refits[names[0]].amplitude[0], other.amplitude[0]])))
    left = search.left(both)
    if left is None:
        return steps
    naming, posterior = search.weigh(both, part_of(progress, 0.6, 0.4))
    rest = _step(naming, search.where(both, left), names, both, posterior)
    return (*steps, rest) if rest.place is not None or not rest.unknown else steps


def _step(naming: Naming, place: Place | None, base: tuple[str, ...], fitted: BaselineFit,
          posterior: Hypotheses) -> Step:
    unknown = _says_nothing(naming) or posterior.unexplained() >= UNKNOWN
    return replace(_unnamed(naming, place, base, fitted), unknown=unknown, unexplained=posterior.unexplained(),
                   change=posterior.likeliest_change())


def _says_nothing(naming: Naming) -> bool:
    """Whether the data speak for no term: not for the likeliest alone, nor for it beside another."""
    return naming.nats[naming.leader] <= 0.0 and naming.probability[naming.leader] < UNKNOWN


def _unnamed(naming: Naming, place: Place | None, base: tuple[str, ...], fitted: BaselineFit) -> Step:
    before, after, average = unseen_scores(naming, fitted)
    if place is not None:
        place = replace(place, test=replace(place.test, column=fitted.evidence.index(place.column.name)))
    free = None if place is None else place.correction.log_after
    return Step(naming, place, before, after, average, free, False, base, fitted)


def with_probabilities(naming: Naming, posterior: Hypotheses, beside: bool = False) -> Naming:
    """The names with their inclusion probabilities, the likeliest first, and the smallest set that holds SURE of what
    is explained; whoever is in it is there with what hardly differs from it. One name alone must be as sure as that by
    itself. beside: names count beside what is unexplained, too."""
    inclusion = posterior.inclusion(beside)
    probability = {name: inclusion.get(name, 0.0) for name in naming.probability}
    ranked = sorted((name for name in naming.refits if name in probability), key=lambda name: -probability[name])
    explained = 1.0 - (posterior.share("unexplained") if beside else posterior.unexplained())
    chosen: list[str] = []
    for name in ranked:
        held = posterior.held_by(chosen, beside)
        alone = bool(chosen) and (probability[chosen[0]] >= SURE or probability[name] < ANY)
        if held >= SURE * explained and (len(chosen) > 1 or alone):
            break
        chosen.append(name)
    aliases = naming.aliases if ranked[0] == naming.leader else ()
    twins = [twin for name in chosen for twin in naming.kin.get(name, ())
             if probability.get(twin, 0.0) > TWIN * probability[name]]
    chosen += [name for name in dict.fromkeys((*aliases, *twins)) if name not in chosen]
    return replace(naming, probability=dict(sorted(probability.items(), key=lambda item: -item[1])),
                   chosen=tuple(chosen), aliases=aliases)


def unseen_scores(naming: Naming, fitted: BaselineFit) -> tuple[Each, Each, Each]:
    """Log scores [n] of unseen shots (without any name, with the leading one, averaged over all refitted ones that are
    possible)."""
    before = unseen_score(without(fitted.evidence))
    scores = {name: unseen_score(one.evidence) for name, one in naming.refits.items()
              if name == naming.leader or naming.nats[name] > NEVER}
    return before, scores[naming.leader], averaged(naming, before, scores)


def averaged(naming: Naming, before: Each, scores: dict[str, Each]) -> Each:
    """Log score [n] of unseen shots by all refitted names and none, each as likely as the other folds' shots make it.

    For forecasts: a name that is one of several likely ones forgoes what the others know (Hoeting et al. 1999).
    """
    fold = folds_of(len(before))
    each = np.stack([before, *scores.values()])
    nats = np.array([0.0, *(naming.nats[name] for name in scores)])
    result = np.zeros(len(before))
    for held in range(fold.max() + 1):
        out = fold == held
        log_weight = nats - (each[:, out] - before[out]).sum(1)
        result[out] = logsumexp(each[:, out].T + log_weight - logsumexp(log_weight), axis=1)
    return result


def judge_left(asked: Asked, seed: int) -> Judged:
    """All tests of what is left beside what was found already."""
    return judge(asked.scores, [test.family for test in asked.tests], ALLOWANCE, DRAWS, seed, lambda done, note: None)


def clearly(gain: Each, fitted: BaselineFit) -> bool:
    """Whether log scores [n] of unseen shots gain more than CLEARLY standard errors, and more than CLEARLY nats."""
    return bool(gain.mean() > CLEARLY * clustered_error(gain, fitted.together) and gain.sum() > CLEARLY)
