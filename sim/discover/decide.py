"""The decision: which effects are reported, how they are reported, and which of them are adopted.

**Effects.** L is the likeliest term; the rest is what calibrated tests still find once L has been added to the model.
The first row whose condition holds applies:

| | posterior and tests | reported |
|---|---|---|
| 1 | nats for L <= 0 and P(L) < 0.5, or only one effect is missing | *one effect* |
| 2 | more is missing, there is no rest, and P(L beside an unexplained effect) >= 0.5 | L's names |
| 3 | more is missing, and there is no rest | *one effect* |
| 4 | the rest is unexplained and acts in L's own direction | unknown |
| 5 | the rest is unexplained, or two terms would put a known number out of nature | L's names; another, unknown |
| 6 | no pair of terms can be simulated | *one effect* |
| 7 | two terms | the names of both terms; what is left beside both, if anything, as *one effect* |

*One effect* is unknown if nats for L <= 0 and P(L) < 0.5, or if P(an unexplained effect) >= 0.5; otherwise it has L's
names. More is missing if P(L's size differs from ball to ball) >= 0.5, or if P(two effects) >= 0.5 and the odds of two
effects against one are at least STRONG times the prior odds. The rest is unexplained if L's size differs from ball to
ball, or if a term together with an unexplained effect is likelier than two terms.

**Guards.** An effect keeps its names, and any effect that was found after it, only if no row below applies to the fit
of its likeliest name. Otherwise it is reported as unknown, its sentence gives the reason, and no part of it is adopted.

| guard | a name is withheld if |
|---|---|
| `at_limit` | a number or a scatter of the fit stopped at the end of its range |
| `out_of_nature` | a number of a believed term lies CREDIBLE_SD standard deviations of the fit's prior off its centre |
| `too_large` | the effect, not measured otherwise, would be more than MOST_USUAL times its usual size in such a place |

**Names.** The names are the smallest set that holds at least SURE of the explained probability; it is a single name
only if that name alone is so probable. Three kinds of names are added: aliases of members, whatever their probability;
names that one linear step cannot distinguish from a member and that are at least TWIN times as probable; and numbers of
the tracker that explain equally well what has changed since an earlier session. If one name remains, the verdict is
*named*; if several remain, it is *set*, and `form_of` chooses the sentence.

**No effect.** The verdict is *none*, and there is no set.

**Adoption.** The candidates are everything that was found and then the effects with a name alone; the first candidate
that no row refuses is adopted.

| measure on hold-out shots | refused if |
|---|---|
| a fitted number | it stopped at the end of its range |
| ends of tracks, forecast from the settings without the tracker's errors | no closer than the present belief's |
| outcomes of tracked shots | forecast worse, by CLEARLY standard errors, than by their overall frequencies |
| log score with balls other than this session's or, failing that, of the session's shots | 90 % interval below 0 |
| points of aim and gate | mean gain below 0 |

If no effect has a name, the average of the names that come closest is adopted, provided that the 90 % interval of its
gain in points lies above 0. Otherwise the present belief stays.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from scipy.special import logsumexp

from truearc.sim.discover.detect import battery
from truearc.sim.discover.detect.battery import ALLOWANCE, Asked, Judged, ask_everything, judge, rivals_of
from truearc.sim.discover.detect.covariates import Covariate, Factor
from truearc.sim.discover.detect.localization import Place, locate
from truearc.sim.discover.finding import Adoption, FitSummary
from truearc.sim.discover.select.posterior import SHARES, Hypotheses, Hypothesis, weigh
from truearc.sim.discover.select.terms import MOST_USUAL, NEVER, SURE, Naming, name_terms
from truearc.sim.infer.intervals import NumberChange
from truearc.sim.infer.launcher import STRONG, LauncherFit
from truearc.sim.infer.likelihood.data import Each
from truearc.sim.infer.likelihood.score_table import Column, clustered_error, folds_of
from truearc.sim.infer.model import Tested
from truearc.sim.printed import Progress, part_of
from truearc.sim.statistics import Z90

# Chosen: half. Measured: without near copies a drag twice too large stands alone on a throwing robot's tracks;
# one set of 162 development worlds is larger with them (git show 0e4d587e)
TWIN = 0.5                            # share of a name's probability that a nearly equal name must have to be added
# Chosen: what is printed as 0 or 1 %
ANY = 0.01                            # probability of names below which they do not explain the effect
LIKELY = 0.5                          # probability above which something is more likely than not
# Derived: the normal quantile 0.975, and a likelihood interval of 95 % (Wilks 1938), rounded
CLEARLY = 2.0                         # standard errors by which plain shares or a free curve must be better
# Derived: 5 % then coincides with a draw, and is known to 0.7 %
DRAWS = 999                           # sign flips after the first step, whose false-alarm rate is the stated one


@dataclass(frozen=True)
class Step:
    """One effect.

    before, after, average, free [n]: log scores of hold-out shots without the effect, with the leading name, averaged
    over all names by probability, and with the free curve. `fitted` includes the other named effects.
    unexplained: probability of a change that no term explains, alone or in addition to one; change: the likeliest such
    change, with the name that accompanies it.
    unknown, chosen: the decision: no term explains the effect, or else the columns of its possible terms, likeliest
    first.
    withheld: the reason why a name that explains the effect is withheld; "" if none is.
    """

    naming: Naming
    place: Place | None
    before: Each
    after: Each
    average: Each
    free: Each | None
    base: tuple[str, ...]             # names added earlier
    fitted: LauncherFit               # without this effect
    unexplained: float = 0.0
    change: Hypothesis | None = None
    unknown: bool = False
    chosen: tuple[str, ...] = ()
    withheld: str = ""

    @property
    def refit(self) -> LauncherFit:
        return self.naming.refits[self.naming.leader]

    @property
    def column(self) -> Column:
        """The column of the leading name in `fitted`."""
        return self.fitted.scores.columns[self.fitted.scores.index(self.naming.leader)]


@dataclass(frozen=True)
class Search:
    """The data and settings of all tests of one search. shots: number of shots in the dataset."""

    shots: int
    covariates: tuple[Covariate, ...]
    factors: tuple[Factor, ...]
    false_alarm: float
    seed: int
    home: battery.ReferenceSession | None = None          # session relative to which changes are tested
    paired: str = battery.LAUNCH_SPEED                    # column that pairs of covariates are tested on; "": none

    def ask(self, fitted: LauncherFit) -> Asked:
        """Return all tests of the fit, with the misfit of the reference session subtracted."""
        home = None if self.home is None else self.home.among(fitted)
        return ask_everything(fitted.scores, self.covariates, self.factors, self.shots, home, self.paired)

    def left(self, fitted: LauncherFit) -> tuple[Asked, Judged] | None:
        """Return all tests and their judgement if anything remains beside the effects already found; else None."""
        asked = self.ask(fitted)
        judged = judge_left(asked, self.seed) if asked.tests else None
        return None if judged is None or judged.p_any > self.false_alarm else (asked, judged)

    def where(self, fitted: LauncherFit, left: tuple[Asked, Judged]) -> Place | None:
        """Return the place of what remains."""
        return locate(fitted.scores, *left, self.false_alarm, self.shots, self.seed)

    def weigh(self, fitted: LauncherFit, place: Place | None, base: tuple[str, ...],
              progress: Progress) -> "Weighed":
        """Return the hypotheses about what the fit lacks beside the names of `base`."""
        naming = name_terms(fitted, lambda done, note: progress(0.5 * done, note))
        posterior = weigh(fitted, naming, self.covariates, self.factors, self.home)
        progress(1.0, "weighed")
        naming = replace(naming, inclusion=posterior.inclusion(), sizes=posterior.sizes())
        step = replace(make_step(naming, place, base, fitted), unexplained=posterior.unexplained(),
                       change=posterior.likeliest_change())
        return Weighed(step, posterior)


@dataclass(frozen=True)
class Weighed:
    """One more effect of a fit, and all hypotheses about what the fit lacks."""

    step: Step
    posterior: Hypotheses

    def beside(self) -> Step:
        """Return the effect if the unexplained change is another effect: names in addition to it count, too."""
        naming = replace(self.step.naming, inclusion=self.posterior.inclusion(beside=True))
        return replace(self.step, naming=naming, unexplained=self.posterior.share("unexplained"))


def decide(fitted: LauncherFit, place: Place | None, search: Search, progress: Progress) -> tuple[Step, ...]:
    """Return the reported effects, at least one, in the order in which they were found."""
    return guarded(found_effects(fitted, place, search, progress))


def guarded(steps: tuple[Step, ...]) -> tuple[Step, ...]:
    """Return the effects up to the first whose names a guard withholds; that one is unknown."""
    for k, step in enumerate(steps):
        why = "" if step.unknown else next(filter(None, (guard(step) for guard in GUARDS)), "")
        if why:
            label = step.fitted.model.label_of(step.naming.leader)
            return (*steps[:k], replace(step, unknown=True, withheld=f"with {label}, {why}"))
    return steps


def at_limit(step: Step) -> str:
    model = step.refit.model
    found = [_said(name, "stopped at", f"{value:.4g}", model)
             for name, value in model.stopped(step.refit.scores).items()]
    return f"{' and '.join(found)}, the end of its range" if found else ""


def out_of_nature(step: Step) -> str:
    return " and ".join(_said(name, "would have to be", f"{value:.3g}", step.refit.model)
                        for name, value in strange(step.refit).items())


def too_large(step: Step) -> str:
    """Compare the sizes of the refit and of the report with the usual size, without allowance for their errors.

    A size that was measured independently is never too large.
    """
    found, usual = step.refit, step.column.usual
    name = found.names[0]
    if name in found.model.layout.measured:
        return ""
    size = max(abs(float(found.amplitude[0])), abs(step.naming.told(step.fitted, name)[0]))
    return (f"{_meaning(name, found.model)} would have to be {size / usual:.1f} times as large as is usual in such a "
            "place" if size > MOST_USUAL * usual else "")


def _said(name: str, verb: str, value: str, model: Tested) -> str:
    """Return a phrase such as "wind upward (wind_z.speed_m_s) would have to be 9 m/s"."""
    described = model.describe(name)
    if described is None:
        return f"{name} {verb} {value}"
    unit = described[1]
    return f"{_meaning(name, model)} {verb} {value}{'' if unit == '1' else f' {unit}'}"


def _meaning(name: str, model: Tested) -> str:
    described = model.describe(name)
    return f"{described[0]} ({name})" if described else name


GUARDS: tuple[Callable[[Step], str], ...] = (at_limit, out_of_nature, too_large)


def found_effects(fitted: LauncherFit, place: Place | None, search: Search, progress: Progress) -> tuple[Step, ...]:
    """Return the effects according to posterior and tests, before any guard."""
    found = search.weigh(fitted, place, (), part_of(progress, 0.0, 0.5))
    posterior, whole = found.posterior, one_effect(found)
    varies = posterior.share("varies") >= LIKELY
    if says_nothing(whole.naming) or not (varies or holds_more(posterior)):                     # row 1
        return (whole,)
    both = not varies and posterior.share("both") > posterior.share("two")
    first = as_named(found.beside(), posterior, True) if both else as_named(found.step, posterior)
    named = fitted.beside(first.refit)
    left = search.left(named)
    if left is None:                                                                            # rows 2 and 3
        return (first if posterior.share("both") >= LIKELY and 1.0 - posterior.unexplained() > ANY else whole,)
    if varies or both:
        change = posterior.likeliest_change(first.naming.leader)
        if both and place is not None and change is not None and _direction(fitted, change) == (
                first.column.direction):                                                        # row 4
            return (as_unknown(whole),)
    else:
        pair, change = posterior.likeliest_pair(), None
        if pair is None:                                                                        # row 6
            return (whole,)
        if not strange(pair, True).keys() - strange(first.refit, True).keys():                  # row 7
            two = take_apart(fitted, first, pair, part_of(progress, 0.5, 0.3))
            return (*map(as_named, two.steps), *_beside_both(two.both, two.names, search, part_of(progress, 0.8, 0.2)))
    # row 5
    return (first, *map(as_unknown, rest_beside(named, search.where(named, left), first.naming.leader, change)))


def _beside_both(both: LauncherFit, names: tuple[str, ...], search: Search, progress: Progress) -> tuple[Step, ...]:
    """Return the effect that remains beside two names, if it has a name or a place."""
    left = search.left(both)
    if left is None:
        return ()
    rest = one_effect(search.weigh(both, search.where(both, left), names, progress))
    return (rest,) if rest.place is not None or not rest.unknown else ()


def _direction(fitted: LauncherFit, change: Hypothesis) -> str:
    assert change.family is not None
    return fitted.scores.columns[change.family.part.columns[0]].direction


def one_effect(found: Weighed) -> Step:
    """Return the effect, assuming that nothing else is missing."""
    if says_nothing(found.step.naming) or found.posterior.unexplained() >= LIKELY:
        return replace(as_named(found.step, found.posterior), unknown=True)
    return as_named(found.step, found.posterior)


def as_unknown(step: Step) -> Step:
    """Return the effect without a name."""
    return replace(step, unknown=True)


def as_named(step: Step, posterior: Hypotheses | None = None, beside: bool = False) -> Step:
    """Return the effect with its credible set of names."""
    return replace(step, unknown=False, chosen=credible_set(step.naming, posterior, beside))


def says_nothing(naming: Naming) -> bool:
    """Return whether the data support no term, neither the likeliest alone nor in addition to another effect."""
    return naming.nats[naming.leader] <= 0.0 and naming.probability[naming.leader] < LIKELY


def holds_more(posterior: Hypotheses) -> bool:
    """Return whether two effects are more likely than one because of the data and not of the prior of pairs."""
    one, more = posterior.share("one"), posterior.share("two") + posterior.share("both")
    return more >= LIKELY and more > STRONG * ((SHARES["two"] + SHARES["both"]) / SHARES["one"]) * one


def credible_set(naming: Naming, posterior: Hypotheses | None, beside: bool = False) -> tuple[str, ...]:
    """Return the names of one effect, likeliest first.

    posterior None: exactly one name is true. beside: names in addition to an unexplained change count, too.
    """
    probability, chosen, explained = naming.probability, list[str](), 1.0
    if posterior is not None:
        explained -= posterior.share("unexplained") if beside else posterior.unexplained()
    for name in naming.ranked:
        held = (sum(probability[one] for one in chosen) if posterior is None else posterior.held_by(chosen, beside))
        alone = bool(chosen) and (probability[chosen[0]] >= SURE or probability[name] < ANY)
        if held >= SURE * explained and (len(chosen) > 1 or alone):
            break
        chosen.append(name)
    twins = [twin for name in chosen for twin in naming.kin.get(name, ()) if posterior is not None
             and probability.get(twin, 0.0) > TWIN * probability[name]]
    return (*chosen, *(name for name in dict.fromkeys((*naming.aliases, *twins)) if name not in chosen))


def make_step(naming: Naming, place: Place | None, base: tuple[str, ...], fitted: LauncherFit) -> Step:
    """Return one effect with its names, before the decision."""
    before, after, average = unseen_scores(naming, fitted)
    if place is not None:
        place = replace(place, test=replace(place.test, column=fitted.scores.index(place.column.name)))
    return Step(naming, place, before, after, average, None if place is None else place.correction.log_after, base,
                fitted)


def rest_beside(named: LauncherFit, place: Place | None, name: str, change: Hypothesis | None) -> tuple[Step, ...]:
    """Return the effect that remains beside a name, if it has a place."""
    if place is None:
        return ()
    naming = name_terms(named, lambda done, note: None)
    return (replace(make_step(naming, place, (name,), named), change=change and replace(change, names=())),)


@dataclass(frozen=True)
class Pair:
    """Two effects, each named while the other is in the model, and the fit with both."""

    steps: tuple[Step, Step]
    both: LauncherFit

    @property
    def names(self) -> tuple[str, str]:
        return self.steps[0].naming.leader, self.steps[1].naming.leader


def take_apart(fitted: LauncherFit, first: Step, pair: LauncherFit, progress: Progress) -> Pair:
    """Return one effect for each of two names; the rivals of each are judged with the other in the model.

    The second is the likeliest after a true refit beside the first; the closed form of the pair is only an estimate.
    """
    lead = 0 if pair.names[0] == first.naming.leader else 1
    beside = fitted.beside(fitted.with_terms((pair.names[lead],), pair.amplitude[[lead]]))
    second = name_terms(beside, part_of(progress, 0.0, 0.5), {pair.names[1 - lead]: float(pair.amplitude[1 - lead])})
    other = second.refits[second.leader]
    base = fitted.beside(fitted.with_terms((second.leader,), other.amplitude))
    naming = name_terms(base, part_of(progress, 0.5, 0.5), {pair.names[lead]: float(pair.amplitude[lead])})
    names, sizes = (naming.leader, second.leader), first.naming.sizes
    start = np.array([naming.refits[names[0]].amplitude[0], other.amplitude[0]])
    return Pair((make_step(replace(naming, sizes=sizes), first.place, (), base),
                 make_step(replace(second, sizes=sizes), None, (pair.names[lead],), beside)),
                fitted.beside(fitted.with_terms(names, start)))


def strange(fit: LauncherFit, trackers: bool = False) -> dict[str, float]:
    """Return the believed numbers far outside their prior, which means that an added term may represent another effect;
    those of a tracker, which are reported separately, only if `trackers`."""
    return fit.model.strange(fit.scores, fit.names, trackers)


def unseen_scores(naming: Naming, fitted: LauncherFit) -> tuple[Each, Each, Each]:
    """Return log scores [n] of hold-out shots: without any name, with the leading name, and averaged over all refitted
    names that are possible."""
    before = fitted.held_out()
    scores = {name: one.scores.held_out() for name, one in naming.refits.items()
              if name == naming.leader or naming.nats[name] > NEVER}
    return before, scores[naming.leader], averaged(naming, before, scores)


def averaged(naming: Naming, before: Each, scores: dict[str, Each]) -> Each:
    """Return the log score [n] of hold-out shots averaged over all refitted names and no name, weighted by their
    probabilities given the other folds.

    Forecasts use this average because a single name discards the information in the others (Hoeting et al. 1999).
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
    """Return the judgement of all tests of what remains beside the effects already found."""
    return judge(asked.scores, [test.family for test in asked.tests], ALLOWANCE, DRAWS, seed, lambda done, note: None)


def clearly(gain: Each, fitted: LauncherFit) -> bool:
    """Return whether log scores [n] of hold-out shots gain more than CLEARLY standard errors and CLEARLY nats."""
    return bool(gain.mean() > CLEARLY * clustered_error(gain, fitted.scores.together) and gain.sum() > CLEARLY)


class Judgement(NamedTuple):
    """The verdict on an effect: named, set or unknown.

    terms: the set; None without a name. rivals: numbers that may have changed instead of the first term, and that term,
    each with its share of the term's probability.
    """

    verdict: str
    terms: tuple[str, ...] | None
    rivals: tuple[NumberChange, ...]


def verdict_of(first: Step, fitted: LauncherFit, home: LauncherFit | None) -> Judgement:
    """Return the verdict on the first effect. home: fit of the earlier session if changes since then were tested."""
    if first.unknown:
        return Judgement("unknown", None, ())
    terms = tuple(name.partition(".")[0] for name in first.chosen)
    leader = next(name for name in first.naming.probability if name.partition(".")[0] in terms)
    rivals = () if home is None else rivals_of(fitted, home, leader)
    if rivals:
        terms = tuple(dict.fromkeys((*(one.name.partition(".")[0] for one in rivals), *terms)))
    return Judgement("named" if len(terms) == 1 else "set", terms, rivals)


def form_of(members: Sequence[float]) -> str:
    """Return the kind of sentence about names of these probabilities, likeliest first: one, both, likely or several."""
    if len(members) == 1:
        return "one"
    if len(members) == 2 and sum(members) > 1.0 + LIKELY:
        return "both"
    return "likely" if members[0] > max(LIKELY, STRONG * members[1]) else "several"


class Adoptable(Protocol):
    """A simulation that may be adopted; its hold-out forecasts are evaluated on demand."""

    @property
    def why(self) -> str:
        """The reason why it lacks a free curve that was found; "" otherwise."""
    @property
    def empty(self) -> bool:
        """Whether it contains nothing that was found."""
    @property
    def at_limit(self) -> dict[str, float]:
        """Parameters that stopped at the end of their range."""
    @property
    def ends_m(self) -> tuple[float, float] | None:
        """Errors of track ends, forecast by the present belief and by this one, without the tracker's own errors; None
        without tracks."""
    @property
    def beaten(self) -> float | None:
        """Standard errors by which it forecasts outcomes of tracked shots better than their overall frequencies do."""
    @property
    def gain(self) -> tuple[float, float] | None:
        """90 % interval of the gain in log score per shot."""
    @property
    def other_balls(self) -> bool:
        """Whether `gain` is for balls other than this session's."""
    @property
    def points(self) -> Adoption | None:
        """Points that hold-out shots would have scored; None without a target."""


AnyAdoptable = TypeVar("AnyAdoptable", bound=Adoptable)


@dataclass(frozen=True)
class Choice(Generic[AnyAdoptable]):
    """The adopted simulation.

    why: reason why not everything that was found is adopted; "" if it is. points: those of the first trial that was
    judged by points. at_limit: parameters of the trials that stopped at the end of their range.
    """

    trial: AnyAdoptable
    why: str
    points: Adoption | None
    at_limit: dict[str, float]


def choose(trials: Iterable[AnyAdoptable], nearest: Callable[[], AnyAdoptable] | None, nothing: AnyAdoptable,
           why: str) -> Choice[AnyAdoptable]:
    """Return the first of `trials` that is not refused; else `nearest`, if its 90 % interval of points gained is
    above 0; else `nothing`.

    why: reason why the first trial lacks something that was found.
    """
    first: Adoption | None = None
    at_limit: dict[str, float] = {}
    for trial in trials:
        at_limit |= {} if trial.empty else trial.at_limit
        refused, points = refuse(trial), None
        if not refused and (points := trial.points) is not None and points.gain < 0.0:
            refused = (f"aimed and gated by it, hold-out shots would have scored {-points.gain:.2f} points per shot "
                       f"less (90 %: {points.low90:+.2f} to {points.high90:+.2f})")
        first = first or points
        if not refused and not trial.empty:
            return Choice(trial, why, first, at_limit)
        why = why or refused or trial.why
    if nearest is not None and not refuse(average := nearest()):
        points = average.points
        if points is not None and points.low90 > 0.0:
            return Choice(average, why, points, at_limit)
    return Choice(nothing, why, first, at_limit)


def refuse(trial: Adoptable) -> str:
    """Return the first reason why a simulation is not adopted; "" if there is none. Points are judged last."""
    if trial.at_limit:
        return f"beside them {', '.join(trial.at_limit)} stopped at the end of its range"
    if (ends_m := trial.ends_m) is not None and ends_m[1] >= ends_m[0]:
        return (f"without the tracker's own errors hold-out tracks end {ends_m[1]:.3f} m from where they are forecast "
                f"to, by what is believed {ends_m[0]:.3f} m")
    if not trial.empty and (why := contradicted(trial.beaten)):
        return why
    if (gain := trial.gain) is not None and gain[1] < 0.0:
        return ("forecasts of other balls than this session's would be worse (90 % interval)" if trial.other_balls else
                "forecasts of hold-out shots are worse (90 % interval)")
    return ""


def contradicted(beaten: float | None) -> str:
    """Return why tracks and outcomes contradict each other; "" if they do not."""
    return "" if beaten is None or beaten > -CLEARLY else (
        "from the settings alone it forecasts outcomes worse than their plain shares do: tracks and outcomes "
        "contradict each other")


def gain_interval(fit: FitSummary) -> tuple[float, float] | None:
    """Return the 90 % interval of the log score gained per shot."""
    if fit.gain_per_shot is None or fit.gain_se is None:
        return None
    return fit.gain_per_shot - Z90 * fit.gain_se, fit.gain_per_shot + Z90 * fit.gain_se
