"""Effects that may be missing in a fit, each with what its names and a free curve gain on hold-out shots.

A search starts from the ranked terms and the hypotheses over them. Which of its steps are reported, and as what,
is decided by truearc.sim.discover.decide.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp

from truearc.sim.discover.detect.battery import ALLOWANCE, Asked, ReferenceSession, ask_everything
from truearc.sim.discover.detect.covariates import Covariate, Factor
from truearc.sim.discover.detect.localization import Place, locate
from truearc.sim.discover.detect.score_test import Judged, judge
from truearc.sim.discover.select.posterior import Hypotheses, Hypothesis, weigh
from truearc.sim.discover.select.terms import NEVER, Naming, name_terms
from truearc.sim.infer.launcher import LauncherFit
from truearc.sim.infer.likelihood.score_table import Array, Column, clustered_error, folds_of
from truearc.sim.printed import Progress, part_of

DRAWS = 999                           # after the first step, whose probability is the one that is promised
CREDIBLE_SD = 4.0                     # standard deviations of a prior, in which a term's number is believable
CLEARLY = 2.0                         # standard errors by which a free curve is better on unseen shots
Each = Float[Array, " n"]             # a number of each shot


@dataclass(frozen=True)
class Step:
    """One effect. `before`, `after`, `average`, `free` [n]: log scores of unseen shots without it, with the leading
    name, with all names as far as they are likely, with the free curve. Other named effects are in `fitted`.

    unexplained: probability of a change that no term explains, alone or beside one; change: the likeliest such change,
    with the name that it stands beside.
    unknown, chosen: the decision. No term explains it; else the columns of the terms that it may be, likeliest first.
    """

    naming: Naming
    place: Place | None
    before: Each
    after: Each
    average: Each
    free: Each | None
    base: tuple[str, ...]             # names put in before
    fitted: LauncherFit               # without this effect
    unexplained: float = 0.0
    change: Hypothesis | None = None
    unknown: bool = False
    chosen: tuple[str, ...] = ()

    @property
    def refit(self) -> LauncherFit:
        return self.naming.refits[self.naming.leader]

    @property
    def column(self) -> Column:
        """Of the leading name, in `fitted`."""
        return self.fitted.scores.columns[self.fitted.scores.index(self.naming.leader)]


@dataclass(frozen=True)
class Search:
    """The data and settings of all tests of one search. shots: how many the dataset has."""

    shots: int
    covariates: tuple[Covariate, ...]
    factors: tuple[Factor, ...]
    false_alarm: float
    seed: int
    home: ReferenceSession | None = None          # the session since which changes are looked for

    def ask(self, fitted: LauncherFit) -> Asked:
        """All tests of the fit, the misfit of the reference session subtracted."""
        home = None if self.home is None else self.home.among(fitted)
        return ask_everything(fitted.scores, self.covariates, self.factors, self.shots, self.seed, home)

    def left(self, fitted: LauncherFit) -> tuple[Asked, Judged] | None:
        """All tests, judged, if anything is left beside the effects found already."""
        asked = self.ask(fitted)
        judged = judge_left(asked, self.seed) if asked.tests else None
        return None if judged is None or judged.p_any > self.false_alarm else (asked, judged)

    def where(self, fitted: LauncherFit, left: tuple[Asked, Judged]) -> Place | None:
        """Where the rest is."""
        return locate(fitted.scores, *left, self.false_alarm, self.shots, self.seed)

    def weigh(self, fitted: LauncherFit, place: Place | None, base: tuple[str, ...],
              progress: Progress) -> "Weighed":
        """What may be missing in the fit beside the names of `base`."""
        naming = name_terms(fitted, lambda done, note: progress(0.5 * done, note))
        posterior = weigh(fitted, naming, self.covariates, self.factors, self.home)
        progress(1.0, "weighed")
        naming = replace(naming, inclusion=posterior.inclusion())
        step = replace(make_step(naming, place, base, fitted), unexplained=posterior.unexplained(),
                       change=posterior.likeliest_change())
        return Weighed(step, posterior)


@dataclass(frozen=True)
class Weighed:
    """One more effect in a fit, and all hypotheses about what is missing there."""

    step: Step
    posterior: Hypotheses

    def beside(self) -> Step:
        """The effect where what is unexplained is another one: names beside that count, too."""
        naming = replace(self.step.naming, inclusion=self.posterior.inclusion(beside=True))
        return replace(self.step, naming=naming, unexplained=self.posterior.share("unexplained"))


def make_step(naming: Naming, place: Place | None, base: tuple[str, ...], fitted: LauncherFit) -> Step:
    """One effect by its names, not decided."""
    before, after, average = unseen_scores(naming, fitted)
    if place is not None:
        place = replace(place, test=replace(place.test, column=fitted.scores.index(place.column.name)))
    return Step(naming, place, before, after, average, None if place is None else place.correction.log_after, base,
                fitted)


def rest_beside(named: LauncherFit, place: Place | None, name: str, change: Hypothesis | None) -> tuple[Step, ...]:
    """The effect that is left beside a name, where it can be placed."""
    if place is None:
        return ()
    naming = name_terms(named, lambda done, note: None)
    return (replace(make_step(naming, place, (name,), named), change=change and replace(change, names=())),)


@dataclass(frozen=True)
class Pair:
    """Two effects, each named with the other in, and the fit with both."""

    steps: tuple[Step, Step]
    both: LauncherFit

    @property
    def names(self) -> tuple[str, str]:
        return self.steps[0].naming.leader, self.steps[1].naming.leader


def take_apart(fitted: LauncherFit, first: Step, pair: LauncherFit, progress: Progress) -> Pair:
    """An effect for each of two names, its rivals judged beside the other.

    The second is the likeliest beside the first once it is truly refitted, which the pair's closed form only guesses.
    """
    lead = 0 if pair.names[0] == first.naming.leader else 1
    beside = fitted.beside(fitted.with_terms((pair.names[lead],), pair.amplitude[[lead]]))
    second = name_terms(beside, part_of(progress, 0.0, 0.5), {pair.names[1 - lead]: float(pair.amplitude[1 - lead])})
    other = second.refits[second.leader]
    base = fitted.beside(fitted.with_terms((second.leader,), other.amplitude))
    naming = name_terms(base, part_of(progress, 0.5, 0.5), {pair.names[lead]: float(pair.amplitude[lead])})
    names = (naming.leader, second.leader)
    start = np.array([naming.refits[names[0]].amplitude[0], other.amplitude[0]])
    return Pair((make_step(naming, first.place, (), base), make_step(second, None, (pair.names[lead],), beside)),
                fitted.beside(fitted.with_terms(names, start)))


def out_of_nature(found: LauncherFit, before: LauncherFit) -> bool:
    """Whether the fit moves a number that was there before to CREDIBLE_SD standard deviations from what the catalogue
    knows: then the term that was added stands for something else. Numbers of an earlier session may change."""
    known = {column.name for column in before.layout.columns[before.layout.first_shared:]}
    return bool((_strange(found) - _strange(before)) & known)


def _strange(fit: LauncherFit) -> set[str]:
    layout, first = fit.layout, fit.layout.first_shared
    sd = np.sqrt(np.diag(np.linalg.inv(layout.precision)))
    far = np.abs(fit.scores.point[first:] - layout.centre) > CREDIBLE_SD * sd
    return {one.name for one, out in zip(layout.columns[first:], far & layout.in_slot[first:], strict=True)
            if out and not one.told}


def unseen_scores(naming: Naming, fitted: LauncherFit) -> tuple[Each, Each, Each]:
    """Log scores [n] of unseen shots (without any name, with the leading one, averaged over all refitted ones that are
    possible)."""
    before = fitted.held_out()
    scores = {name: one.scores.held_out() for name, one in naming.refits.items()
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


def clearly(gain: Each, fitted: LauncherFit) -> bool:
    """Whether log scores [n] of unseen shots gain more than CLEARLY standard errors, and more than CLEARLY nats."""
    return bool(gain.mean() > CLEARLY * clustered_error(gain, fitted.scores.together) and gain.sum() > CLEARLY)
