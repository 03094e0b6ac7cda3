"""The story of a finding: what changed, where it shows, what it is worth, how sure it is, and what to do next.

The sentences are templates of wording.toml; this module chooses and fills them.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from msgspec import UNSET, UnsetType, structs

from truearc.sim.discover.decide import form_of, gain_interval
from truearc.sim.discover.detect.covariates import STEP, Covariate, CovariatePair, Factor
from truearc.sim.discover.detect.localization import Place
from truearc.sim.discover.finding import FindingRecord, FitSummary, FoundEffect, Named, Story, Unknown, Where
from truearc.sim.discover.identifiability import Sight, TermIdentifiability
from truearc.sim.discover.report import finding_text as wording
from truearc.sim.discover.report.finding_text import WORDING, either, in_words, part_unit, plain, size_of
from truearc.sim.physics.catalogue import Catalogue
from truearc.sim.physics.term import SHARE
from truearc.sim.printed import left_out_lines

SAY: dict[str, str] = WORDING["story"]
STANDS_OUT = 0.2                      # probability of a name, from which its size is said; chosen: one in five
LEAST_SHOWN = 0.005                   # probability of a name that is said: not 0 %; derived: rounding
# Measured: docs/measured/sealed.md
TOO_SURE = 0.95                       # probability of a name by tracks, from which names were right less often
# Chosen: half of what makes it the verdict
UNSURE = 0.25                         # probability of an unexplained effect, from which a sentence says so
SURE = 0.95                           # probability of a stage that needs no number; chosen
MOSTLY = 0.97                         # of the improvement: then a region tells nothing new; derived: rounding
SHOWN = 3                             # names of a list that a sentence has
LISTED = 5                            # names of a set, at most
STAGES = {"sensing": "in what the sensors say", "launch": "at the launch", "flight": "in flight",
          "arrival": "at the target"}
HEIGHTS = {"plane": "heights", "track end": "how high tracks end, from their first 40 %,"}
SIDEWAYS = "how far to the side tracks end, from their first 40 %,"
TIMES = ("t_s", "order_in_session", "shots_of_ball")


def say(key: str, **words: object) -> str:
    """Return a sentence of wording.toml with its words filled in; its first letter is a capital."""
    return capital(SAY[key].format(**words))


def capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def tell(finding: FindingRecord, place: Place | None, among: Catalogue | None = None, tracker: str = "",
         limits: Iterable[str] = ()) -> FindingRecord:
    """Return the finding of an effect with its story; tracker: a sentence about its calibration."""
    leading = FoundEffect(finding.what, finding.set, finding.unknown, finding.unexplained, finding.withheld)
    told = (_say_unknown(leading, place) if finding.verdict == "unknown" else
            _say_names(_members(leading), among, finding.data.topspin))
    also = [say_further(one, among, finding.data.topspin) for one in finding.also]
    story = Story(told, say_where(finding.where, place), sure=_say_sure(finding, leading, among),
                  also=tuple(filter(None, (*also, tracker.strip()))), limits=_stripped(limits))
    return retell(structs.replace(finding, story=story), among)


def tell_none(finding: FindingRecord, blind: Sequence[TermIdentifiability], sight: Sight,
              among: Catalogue | None = None, tracker: str = "", limits: Iterable[str] = ()) -> FindingRecord:
    """Return the finding of no effect with its story.

    blind: terms that these shots could not have shown. tracker: errors that the tracks show by themselves.
    """
    names = [_unseen(one, among) for one in blind[:SHOWN]]
    names += [f"{len(blind) - SHOWN} others"] * (len(blind) > SHOWN)
    shots, p_value = finding.data.shots, finding.mismatch.p_value or 0.0
    change = say("unseen", shots=shots, names=either(names)) if names else say("nothing", shots=shots)
    sure = say("sure_none", chance=wording.say_chance(p_value), p=f"{p_value:.2g}",
               alarm=f"{finding.mismatch.false_alarm:g}")
    story = Story(tracker.strip() or change, worth=_say_smallest(sight, among), sure=sure,
                  also=(change,) if tracker else (), limits=_stripped(limits))
    return retell(structs.replace(finding, story=story), among)


def no_test(shots: int) -> Story:
    """Return the story of data that carry no test."""
    return Story(say("no_test", shots=shots))


def retell(finding: FindingRecord, among: Catalogue | None = None, limits: Iterable[str] = ()) -> FindingRecord:
    """Return the finding with what it is worth, what to do next and further limits in its story and its sentence."""
    story = finding.told
    story = structs.replace(story, worth=_say_worth(finding) or story.worth, next=_say_next(finding, among),
                            limits=(*story.limits, *_stripped(limits)))
    return structs.replace(finding, story=story, sentence=story.text)


def _stripped(sentences: Iterable[str]) -> tuple[str, ...]:
    return tuple(one.strip() for one in sentences if one)


def _members(effect: FoundEffect) -> list[Named]:
    names = effect.set or tuple(one.term for one in effect.what[:1])
    return [one for one in effect.what if one.term in names]


def _say_names(members: Sequence[Named], among: Catalogue | None, topspin: bool) -> str:
    """One name with its size, or the likeliest of those that cannot be told apart."""
    first = members[0]
    effect, form = wording.say_name(first, among, topspin), form_of([one.probability for one in members])
    if form == "several" and first.probability < STANDS_OUT:
        form = "vague"
    stages = either(list(dict.fromkeys(STAGES[one.stage] for one in members)))
    return say(form, effect=effect, stages=stages, name=plain(first.term, among), share=f"{first.probability:.0%}",
               names=_listed(members, among))


def _listed(members: Sequence[Named], among: Catalogue | None, last: str = "or") -> str:
    """Names with their probabilities, LISTED at most."""
    more = len(members) - LISTED + 1
    shown = members if more <= 1 else members[:LISTED - 1]
    rest = [f"one of {more} others"] if more > 1 else []
    return either([f"{plain(one.term, among)} ({one.probability:.0%})" for one in shown] + rest, last)


def _say_unknown(effect: FoundEffect, place: Place | None) -> str:
    """An effect without a name, by how the real shots differ."""
    withheld = isinstance(effect.withheld, str)
    looks = "" if effect.unknown is None or place is None else say_looks(effect.unknown, place)
    text = say("withheld" if withheld else "unknown", why=effect.withheld, looks=looks)
    return text if looks else text.removesuffix(": .") + "."


def say_looks(unknown: Unknown, place: Place) -> str:
    """Return how the real shots differ, and along with what."""
    words, what = place.column.words[unknown.amplitude < 0.0], place.test.what
    size, name = say_size(abs(unknown.amplitude), unknown.unit), in_words(unknown.covariate or "")
    if unknown.low90 is not None and unknown.high90 is not None:
        ends = (unknown.low90, unknown.high90) if unknown.amplitude >= 0.0 else (-unknown.high90, -unknown.low90)
        size += f" (90 %: {' to '.join(say_size(end, unknown.unit) for end in ends)})"
    if isinstance(what, Factor):
        return f"{words}, by up to {size}, depending on {name}"
    if isinstance(what, CovariatePair):
        return f"{words}, by up to {size}, as {in_words(what.first.name)} and {in_words(what.second.name)} go together"
    if what is None:
        follows = place.column.follows
        return f"{words}, by {size}, {f'along with {in_words(follows)}' if follows else 'in every shot alike'}"
    if place.test.shape.startswith(STEP):
        return f"{words} where {name} is above {place.test.shape.removeprefix(STEP)}, by {size}: a step, not a drift"
    return f"{words} as {name} grows, by {size} over its range"


def say_size(amount: float, unit: str) -> str:
    """Return an amount of a free column."""
    if unit == "m" and amount >= 1.0:
        return f"{amount:.2g} m"
    factor, text = wording.scale_of(unit)
    return f"{amount * factor:.2g}{text}"


def say_where(where: Where, place: Place | None = None) -> str:
    """Return where it shows: stage, covariate, time in flight, region, and since when; "" if nothing is known."""
    if not where.stage_probability:
        return ""
    ranked = sorted(where.stage_probability.items(), key=lambda item: -item[1])
    stages = [STAGES[stage] if share >= SURE else f"{STAGES[stage]} ({share:.0%})"
              for stage, share in ranked[:SHOWN] if share >= 1.0 - SURE]
    covariate = SAY["covariate"].format(name=in_words(where.covariate)) if where.covariate else ""
    times, region, since = "", "", ""
    if where.times_s:
        end = f"{where.times_s[1]:.2f} s" if where.times_s[1] < 1e3 else "the end"
        times = SAY["times"].format(start=f"{where.times_s[0]:.2f}", end=end)
    if "low" in where.region and where.region["share_of_gain"] < MOSTLY:
        region = SAY["region"].format(
            share=f"{where.region['share_of_gain']:.0%}", name=in_words(where.region["covariate"]),
            low=f"{where.region['low']:.3g}",
            high=f"{where.region['high']:.3g} {part_unit(where.region['covariate'])[1]}".rstrip())
    what = None if place is None else place.test.what
    if place is not None and isinstance(what, Covariate) and what.name in TIMES and place.test.shape.startswith(STEP):
        since = SAY["since"].format(name=in_words(what.name), value=place.test.shape.removeprefix(STEP))
    return say("where", stages=either(stages), covariate=covariate, times=times, region=region, since=since)


def _say_worth(finding: FindingRecord) -> str:
    """Points per ball by what was found; without a target the errors of forecasts."""
    worth = finding.adoption
    if isinstance(worth, UnsetType):
        return say_forecasts(finding.fit) if finding.mismatch.found and finding.fit is not None else ""
    key = "worth_refused" if worth.refused else "worth" if worth.low90 > 0.0 else "worth_unclear"
    return say(key, why=worth.refused, gain=f"{worth.gain:+.2f}", low=f"{worth.low90:+.2f}",
               high=f"{worth.high90:+.2f}")


def _say_sure(finding: FindingRecord, effect: FoundEffect, among: Catalogue | None) -> str:
    """The p-value as a share of datasets, and the other names: at most five."""
    members, p_value = _members(effect), finding.mismatch.p_value or 0.0
    if effect.unknown is not None or effect.set is None:
        instead = "" if isinstance(effect.withheld, str) or not effect.what else _say_nearest(finding, among)
    else:
        form, rest = form_of([one.probability for one in members]), members[1:]
        key = {"likely": "excluded", "both": "together"}.get(form, "instead")
        shown = members if form == "both" else rest
        instead = SAY[key].format(names=_listed(shown, among, "and" if form == "both" else "or")) if rest else (
            SAY["alone"].format(share=f"{members[0].probability:.0%}"))
        if form != "both" and rest and sum(one.probability for one in members) > 1.0 + LEAST_SHOWN:
            instead += SAY["overlap"]
        if isinstance(effect.unexplained, float) and effect.unexplained >= UNSURE:
            instead += SAY["no_term"].format(share=f"{effect.unexplained:.0%}")
        if text := say_how_sure(finding):
            instead += SAY["measured"].format(text=text)
    return say("sure", chance=wording.say_chance(p_value), p=f"{p_value:.2g}", instead=instead)


def _say_nearest(finding: FindingRecord, among: Catalogue | None) -> str:
    """The nearest name of an effect that no term explains, and how it falls short."""
    falls_short = "explains it worse than a free curve does"
    if finding.also:
        left = next((one.unknown.covariate for one in finding.also if one.unknown is not None), None)
        falls_short = "leaves something of the kind over" + (f" that goes with {in_words(left)}" if left else "")
    return SAY["nearest"].format(name=plain(finding.what[0].term, among), falls_short=falls_short,
                                 effect=wording.say_name(finding.what[0], among, False))


def say_how_sure(finding: FindingRecord) -> str:
    """Return how often names as likely as this were right, if that was less often; measured in sealed rounds."""
    sure = bool(finding.what) and finding.what[0].probability >= TOO_SURE and finding.data.level == "L2"
    return "by its own estimate; of such names with tracks, 74 in 100 were right in sealed tests" if sure else ""


def say_further(further: FoundEffect, among: Catalogue | None = None, topspin: bool = False) -> str:
    """Return a further effect: its likeliest name only, since it may well be an error of the one named first."""
    if isinstance(further.withheld, str):
        return say("also_withheld", why=further.withheld)
    if further.unknown is not None:
        name = further.unknown.covariate
        return say("also_unknown", covariate=f", and goes with {in_words(name)}" if name else "")
    members = [one for one in further.what if one.term in (further.set or ())]
    clear = [one for one in members if is_clear(one)]
    if not clear:
        return say("also_vague", names=either([plain(one.term, among) for one in members[:LISTED - 1]]))
    others = [plain(one.term, among) for one in members if one is not clear[0]][:LISTED - 1]
    return say("also", effect=wording.say_name(clear[0], among, topspin),
               instead=SAY["instead"].format(names=either(others)) if others else "")


def is_clear(one: Named) -> bool:
    """Return whether the sign of its size is sure."""
    return one.size.low90 * one.size.high90 > 0.0


def say_tracker(moved: FoundEffect, together: Sequence[Named], p_value: float, among: Catalogue | None = None) -> str:
    """Return the change of the tracker's calibration since the earlier session: what changed, then what may have."""
    likeliest = either([wording.say_name(one, among, False) for one in together], "and")
    others = [one for one in moved.what if one not in together]
    return say("tracker", p=f"{p_value:.2g}", effect=likeliest,
               instead=SAY["instead"].format(names=_listed(others, among)) if others else "")


def _unseen(one: TermIdentifiability, among: Catalogue | None) -> str:
    """A term with the size below which it would have been missed more than one time in five."""
    phrase = wording.phrase_of(one.term, among)
    share = phrase is not None and phrase.unit == SHARE[1]
    if one.smallest is None or (share and one.smallest >= 1.0):       # no share of a size or a speed is larger
        return f"{plain(one.term, among)} of any size"
    less = "slower than" if phrase is not None and phrase.rate else "below"      # a rate is told as its time constant
    return f"{plain(one.term, among)} {less} {size_of(one.term, one.smallest, one.unit, among)}"


def _say_smallest(sight: Sight, among: Catalogue | None) -> str:
    """The smallest effects that would have been seen four times in five, of the terms that these data see best."""
    terms = sorted((one for one in sight.terms if one.smallest is not None),
                   key=lambda one: (one.smallest or 0.0) / one.usual)
    if not terms:
        return say("smallest_none")
    return say("smallest", names=either([f"{plain(one.term, among)} of "
                                         f"{size_of(one.term, one.smallest or 0.0, one.unit, among)}"
                                         for one in terms[:SHOWN]], "and"))


def say_forecasts(fit: FitSummary) -> str:
    """Return the gain of the corrected simulation on hold-out shots; "" without one."""
    interval = gain_interval(fit)
    if interval is None:
        return ""
    parts: dict[bool, list[str]] = {True: [], False: []}          # better, worse
    if fit.accuracy_before is not None and fit.accuracy_after is not None:
        before, after = (f"{100.0 * share:.0f}" for share in (fit.accuracy_before, fit.accuracy_after))
        if before != after:
            parts[fit.accuracy_after > fit.accuracy_before].append(f"{after} of 100 outcomes right instead of {before}")
    old, new, where = fit.height_rmse_before_m, fit.height_rmse_after_m, HEIGHTS[fit.height_at]
    if fit.side_rmse_before_m is not UNSET and fit.side_rmse_after_m is not UNSET:
        old, new, where = fit.side_rmse_before_m, fit.side_rmse_after_m, SIDEWAYS
    if old is not None and new is not None:
        before, after = say_size(old, "m"), say_size(new, "m")
        if before != after:
            parts[new < old].append(f"{where} within {after} instead of {before}")
    places = 3 if abs(fit.gain_per_shot or 0.0) < 10.0 else 0
    low, high = (f"{end:+.{places}f}" for end in interval)
    score = f"log score {fit.gain_per_shot:+.{places}f} per shot, 90 %: {low} to {high}"
    gain = f"forecasts {' and '.join(parts[True])}" if parts[True] else "does better"
    but = f", but forecasts {' and '.join(parts[False])}" if parts[False] else ""
    text = (f"scores worse ({score}): do not adopt it" if interval[1] < 0.0 else
            f"is not clearly better ({score})" if interval[0] <= 0.0 else f"{gain} ({score}){but}")
    return f"On hold-out shots the corrected simulation {text}."


def _say_next(finding: FindingRecord, among: Catalogue | None) -> str:
    """The one thing to do next: adopt a single name that clearly gains, else the first step, else look again."""
    worth = finding.adoption
    gains = not isinstance(worth, UnsetType) and worth.low90 > 0.0 and worth.refused is None
    if finding.verdict == "named" and gains:
        return say("adopt")
    if finding.next:
        return f"{capital(wording.say_step(finding.next[0], among))}."
    names = wording.found_names(finding)
    return say("again", names=",".join((*finding.data.believed, *names))) if names else ""


def table_of(finding: FindingRecord, among: Catalogue | None = None) -> list[tuple[str, str]]:
    """Return (what, value): tests, numbers and limits, which follow the story."""
    data, where, mismatch = finding.data, finding.where, finding.mismatch
    rows = [("shots", f"{data.shots}, level {data.level}; {mismatch.tests_made} test{'s' * (mismatch.tests_made != 1)} "
                      f"over {data.clusters['count']} clusters ({data.clusters['by']})"),
            ("believed", wording.list_believed(data.believed, among))]
    rows += [("fitted without it" if mismatch.found else "fitted",
              ", ".join(f"{name} {value:.3g}" for name, value in values.items()))
             for values in data.fitted.values() if values]
    if likely := [one for one in finding.what[:LISTED] if one.probability >= LEAST_SHOWN]:
        pairs = " (two together count for both)" if sum(one.probability for one in likely) > 1.0 + LEAST_SHOWN else ""
        rows.append(("names", ", ".join(f"{one.term} {one.probability:.0%}" for one in likely) + pairs))
    if mismatch.found and where.stage_probability:
        rows.append(("stages", ", ".join(f"{stage} {p:.0%}" for stage, p in where.stage_probability.items())))
    if where.inseparable:
        rows.append(("inseparable", wording.say_inseparable(where)))
    if not isinstance(finding.adoption, UnsetType):
        rows.append(("points", wording.say_points(finding.adoption).removeprefix("points ")))
    if finding.fit is not None and (text := say_forecasts(finding.fit)):
        rows.append(("forecasts", text))
    rows += [("next", f"{wording.say_step(step, among)}{wording.then_measured(step, finding, among)}")
             for step in finding.next]
    if names := wording.found_names(finding):
        rows.append(("next", f"believe that and look again: --believe {','.join((*data.believed, *names))}"))
    return rows + [(key, line) for key, lines in (("warning", data.accepted), ("note", data.notes),
                                                  ("not tested", data.untested)) for line in lines]


def console_lines(finding: FindingRecord, among: Catalogue | None = None) -> list[str]:
    """Return the story, a sentence a line, and below it the table."""
    story = finding.told
    lines = [one for one in (story.change, story.where, story.worth, story.sure, *story.also, *story.limits) if one]
    lines += [f"Next: {story.next}"] if story.next else []
    return [*lines, *(f"{what}: {value}" for what, value in table_of(finding, among)),
            *left_out_lines(finding.data.left_out)]


def too_little(also: Sequence[FoundEffect]) -> list[str]:
    """Terms that lead further effects whose 90 % intervals all include zero: good for forecasts, but not findings."""
    return [further.what[0].term for further in also if further.unknown is None
            and not any(is_clear(one) for one in further.what if one.term in (further.set or ()))]


def say_adopted(finding: FindingRecord, provenance: Mapping[str, Any]) -> str:
    """Return which effects a belief that was adopted from the finding has, and why not all."""
    named = [f"{name} (as fitted, though too little to be named)" if name in too_little(finding.also) else name
             for name in provenance["adopted"]]
    but = f" (not all: {provenance['refused']})" if "refused" in provenance else ""
    if "at_limit" in provenance:
        return f"adopted: nothing; {', '.join(provenance['at_limit'])} stopped at the end of its range"
    if provenance.get("kept"):
        return f"adopted: nothing, the belief stays{but}"
    listed = ", ".join(named)
    what = f"the average of {listed}, weighted as if just one were there" if provenance["averaged"] else listed
    return f"adopted: {what or 'nothing named, the fitted coefficients alone'}{but}"
