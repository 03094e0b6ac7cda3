"""Sentences about the verdict and the effects found, written for a drive coach to act on."""

import math
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from typing import Any

from msgspec import UNSET, UnsetType

from truearc.sim.discover import finding as findings
from truearc.sim.discover.decide import form_of, gain_interval
from truearc.sim.discover.detect.covariates import STEP, Covariate, CovariatePair, Factor
from truearc.sim.discover.detect.localization import Place
from truearc.sim.discover.finding import FindingRecord, FitSummary, FoundEffect, Interval, Named, Unknown, Where
from truearc.sim.discover.identifiability import Sight, TermIdentifiability
from truearc.sim.infer.room import ROOM
from truearc.sim.physics.catalogue import Catalogue, Nameless, as_catalogue
from truearc.sim.physics.term import ANGLE, LENGTH, SHARE, Phrase
from truearc.sim.printed import left_out_lines

MOST_PLACES = 5                       # after the point; beyond, exponents
WORDING = tomllib.loads((files("truearc.sim.discover.report") / "wording.toml").read_text(encoding="utf-8"))
COLUMNS: dict[str, str] = WORDING["columns"]


def in_words(column: str) -> str:
    """A column as people say it; one that is the user's own: by its name, and so are two together."""
    return " x ".join(COLUMNS.get(one, one) for one in column.split(" x "))


def say_improbable(numbers: Mapping[str, float]) -> str:
    """Say that fitted numbers were believed all but impossible; empty without any."""
    if not numbers:
        return ""
    found = " and ".join(f"{name} {value:.3g}" for name, value in numbers.items())
    tracker = all(name.startswith("track_") for name in numbers)
    what = f"{'the tracker may be as wrong as that, or ' * tracker}an effect may be there that they cannot tell from it"
    return f" But the fit has {found}, believed all but impossible before these shots: {what}."


def say_odd(remarks: Iterable[str]) -> str:
    """Say which fitted numbers lie where physics seldom has them; empty without any."""
    listed = "; ".join(remarks)
    return f" The fit is at an odd place: {listed}." if listed else ""


def plain(name: str, among: Catalogue | None = None) -> str:
    """A term's or column's name as text; among: the catalogue of the terms, here and below."""
    name = name.partition(".")[0]
    term = as_catalogue(among).get(name)
    return name.replace("_", " ") if term is None else term.label


def phrase_of(name: str, among: Catalogue | None = None, topspin: bool = False) -> Phrase | None:
    """The wording of a term's amplitude; None if the name is not a term's, or that of an unexplained effect."""
    term = as_catalogue(among).get(name.partition(".")[0])
    if term is None or isinstance(term, Nameless):
        return None
    return term.topspin_phrase if topspin and term.topspin_phrase is not None else term.phrase


def say_effect(term: str, interval: Interval, sentence: str, among: Catalogue | None = None,
               topspin: bool = False) -> str:
    """The effect with its size and 90 % interval, no full stop; a term that is not in the catalogue: its sentence.

    topspin: the balls' spin is topspin.
    """
    phrase = phrase_of(term, among, topspin)
    if phrase is None:
        unit = "" if interval.unit == "1" else f" {interval.unit}"
        said = sentence.rstrip(".")
        value, lowest, highest = _together(interval.value, interval.low90, interval.high90)
        return f"{said[:1].lower()}{said[1:]} ({value}{unit}, 90 %: {lowest} to {highest})"
    less = interval.value < 0.0
    factor = -phrase.factor if less else phrase.factor
    low, high = sorted((interval.low90 * factor, interval.high90 * factor))
    size = (_time_constant if phrase.rate else _interval)(interval.value * factor, low, high, phrase.unit)
    return (phrase.less if less else phrase.more).format(size)


def say_name(one: Named, among: Catalogue | None = None, topspin: bool = False) -> str:
    """The effect of a name as `say_effect` has it; of a number that was believed first the change, then what it is now.
    """
    value = next(iter(one.parameters.values()))
    said = say_effect(one.term, value, one.sentence, among, topspin)
    if isinstance(one.change, UnsetType):
        return said
    before = size_of(one.term, one.believed or 0.0, value.unit, among)
    return f"{plain(one.term, among)} changed by {interval_of(one.term, one.change, among)} from {before}; now {said}"


def interval_of(name: str, size: Interval, among: Catalogue | None = None) -> str:
    """A term's size or change with its sign and 90 % interval, in the unit of `size_of`; of a rate in its own."""
    phrase, (factor, unit), per = phrase_of(name, among), scale_of(size.unit), ""
    if phrase is not None and not phrase.rate:
        factor, unit, per = phrase.factor, phrase.unit, phrase.per
    low, high = sorted((size.low90 * factor, size.high90 * factor))
    return _interval(size.value * factor, low, high, unit) + per


def _interval(value: float, low: float, high: float, unit: str) -> str:
    said, lowest, highest = _together(value, low, high)
    return f"{said}{unit} (90 %: {lowest} to {highest}{unit})"


def _time_constant(rate: float, low: float, high: float, unit: str) -> str:
    """The inverse of a rate, whose interval's ends swap; a rate that may be zero leaves it without an upper end."""
    if low > 0.0:
        return _interval(1.0 / rate, 1.0 / high, 1.0 / low, unit)
    return f"{_number(_inverse(rate))}{unit} (90 %: at least {_number(_inverse(high))}{unit})"


def _inverse(rate: float) -> float:
    return math.inf if rate == 0.0 else 1.0 / rate


def size_of(name: str, amount: float, unit: str, among: Catalogue | None = None) -> str:
    """An amount of a term's amplitude (or of a free column) as people say it, with the unit that it is per."""
    phrase = phrase_of(name, among)
    if phrase is not None:
        shown = _inverse(amount * phrase.factor) if phrase.rate else amount * phrase.factor
        return f"{_number(shown)}{phrase.unit}{phrase.per}"
    factor, said = scale_of(unit)
    return f"{_number(amount * factor)}{said}"


def scale_of(unit: str) -> tuple[float, str]:
    """(factor, unit with its space) in which a unit of the physics is reported."""
    return {"1": SHARE, "rad": (math.degrees(1.0), "°"), "m": LENGTH, "deg": ANGLE, "m/s2": (1.0, " m/s²")}.get(
        unit, (1.0, f" {unit}"))


def _together(value: float, low: float, high: float) -> tuple[str, str, str]:
    """A value and its interval to as many places as leave the interval's width two figures."""
    width = high - low
    places = max(1 - math.floor(math.log10(width) + 1e-9), 0) if 0.0 < width < math.inf else 3
    if places > MOST_PLACES:
        return _number(value), _number(low), _number(high)
    shown = (f"{round(one, places) + 0.0:.{places}f}" for one in (value, low, high))
    return next(shown), next(shown), next(shown)


def _number(value: float) -> str:
    """Two figures, and no exponents where people use none."""
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    places = max(1 - math.floor(math.log10(abs(value)) + 1e-9), 0)
    return f"{value:.{places}f}" if places <= MOST_PLACES else f"{value:.1e}"


STAGE_WORDS = {"sensing": "in what the sensors say", "launch": "at the launch", "flight": "in flight",
               "arrival": "at the target"}
SHOWN = 6
STANDS_OUT = 0.2                      # probability of a name, from which its size is said; chosen: one in five
RARE = 0.1                            # p up to which it is stated as one dataset in how many; chosen: twice FALSE_ALARM
# Derived: their mean square is 4, of ten by chance once in 10^5
WIDE = 2.0                            # standard deviations by which times differ: chance hardly does that to ten
# Measured: docs/measured/sealed.md
TOO_SURE = 0.95                       # probability of a name by tracks, from which names were right less often
LEAST_SHOWN = 0.005                   # probability of a name on the console: not 0 %; derived: rounding
# Chosen: half of what makes it the verdict
UNSURE = 0.25                       # probability of an unexplained effect, from which a sentence says so
HEIGHTS = {"plane": "heights", "track end": "how high tracks end, from their first 40 %,"}
SIDEWAYS = "how far to the side tracks end, from their first 40 %,"
TIMES = ("t_s", "order_in_session", "shots_of_ball")
LISTED = 4                            # names of a set that a sentence lists
THEN = ("With that put in", "And with that, too")


def say_named(believed: tuple[str, ...], p_value: float, leading: FoundEffect, also: Sequence[FoundEffect],
              fit: FitSummary, place: Place | None, among: Catalogue | None = None, topspin: bool = False) -> str:
    """One name, or those that cannot be told apart, with the size and what it gains."""
    what = leading.what
    names = leading.set or (what[0].term,)
    total = sum(one.probability for one in what if one.term in names)
    members = [one for one in what if one.term in names]
    likeliest = say_name(members[0], among, topspin)
    form = form_of([one.probability for one in members] + [0.0] * (len(names) - len(members)))
    if form == "one":
        said = f"{_missing(believed, among)}: {likeliest}."
    else:
        listed = members[:LISTED if len(names) > LISTED + 1 else LISTED + 1]
        rest = [f"{plain(one.term, among)} ({one.probability:.0%})" for one in listed]
        rest += [f"one of {len(names) - LISTED} others"] if len(names) > LISTED + 1 else []
        stages = list(dict.fromkeys(STAGE_WORDS[one.stage] for one in what if one.term in names))
        cannot = "These data cannot tell which of these it is."
        if total > 1.0 + LEAST_SHOWN:
            cannot += " Two of them may be there together, so that the probabilities add up to more than 100%."
        if form == "both":
            cannot = "More likely both are there than one, but these data cannot tell how large each is."
        first = f" If it is the first{' alone' if form == 'both' else ''}, {likeliest}."
        if members[0].probability < STANDS_OUT:
            first = " No name stands out."
        listing = either(rest, "and" if form == "both" else "or")
        said = f"{_missing(believed, among)}, {either(stages)}: {listing}. {cannot}{first}"
        if form == "likely":
            said = (f"{_missing(believed, among)}: most likely {rest[0]}. If so, {likeliest}. "
                    f"{_capital(either(rest[1:]))} cannot be excluded.")
    unexplained = leading.unexplained
    if isinstance(unexplained, float) and unexplained >= UNSURE:
        said += f" It may also be an effect of no term ({unexplained:.0%})."
    more = "".join(besides(further, then, among, topspin) for further, then in zip(also, THEN, strict=False))
    return said + _since(place) + more + _gained(fit) + _chance(p_value)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def either(names: Sequence[str], last: str = "or") -> str:
    """Names as a list, such as "a, b or c"."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} {last} {names[-1]}"


def _since(place: Place | None) -> str:
    """When it began, where a step in time is what shows it best."""
    if place is None or not isinstance(place.test.what, Covariate) or not place.test.shape.startswith(STEP):
        return ""
    name, cut = place.test.what.name, place.test.shape.removeprefix(STEP)
    return f" It shows best as a step where {in_words(name)} is above {cut}." if name in TIMES else ""


def besides(further: FoundEffect, then: str, among: Catalogue | None = None, topspin: bool = False) -> str:
    """A further effect, after `then`: its likeliest name only, since it may well be an error of the one named first."""
    if isinstance(further.withheld, str):
        return f" {then}, a smaller effect remains that cannot be named: {further.withheld}."
    if further.unknown is not None:
        goes = f", and goes with {in_words(further.unknown.covariate)}" if further.unknown.covariate else ""
        return f" {then}, a smaller effect remains that no term explains{goes}."
    in_set = [one for one in further.what if one.term in (further.set or ())]
    clear = _clear(further)
    if not clear:
        vague = [plain(one.term, among) for one in in_set[:LISTED]]
        return f" Something more remains, too little to be named: perhaps {either(vague)}."
    others = [plain(one.term, among) for one in in_set if one is not clear[0]][:LISTED]
    instead = f"; or {either(others)}" if others else ""
    return f" {then}, what is left looks most as if {say_name(clear[0], among, topspin)}{instead}."


SAME_TRACKER = (" The tracker's calibration as fitted was compared with the earlier session's: beside what is named "
                "here no change is seen.")


def say_tracker(moved: FoundEffect, together: Sequence[Named], p_value: float, among: Catalogue | None = None) -> str:
    """A change of the tracker's calibration since the earlier session: the numbers that changed, then the others."""
    likeliest = either([say_name(one, among, False) for one in together], "and")
    others = [f"{plain(one.term, among)} ({one.probability:.0%})" for one in moved.what if one not in together]
    instead = f"; instead it may be {either(others)}" if others else ""
    return (f" The tracker is not calibrated as in the earlier session (p = {p_value:.2g}): compared with then, "
            f"{likeliest}{instead}.")


def too_little(also: Sequence[FoundEffect]) -> list[str]:
    """Terms that lead further effects whose 90 % intervals all include zero: good for forecasts, but not findings."""
    return [further.what[0].term for further in also if further.unknown is None and not _clear(further)]


def say_limits(at_limit: Mapping[str, float]) -> str:
    """Return a sentence about fitted numbers that stopped at the end of their range; empty where none did."""
    if not at_limit:
        return ""
    found = ", ".join(f"{name} at {value:.4g}" for name, value in at_limit.items())
    return f" A fit stopped at the end of a range ({found}): what it stands for may be something else."


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
    what = f"the average of {listed}, shares of these names alone" if provenance["averaged"] else listed
    return f"adopted: {what or 'nothing named, the fitted coefficients alone'}{but}"


def say_points(adoption: findings.Adoption) -> str:
    """What it is worth in points, aimed by it and let through by its gate."""
    passed = [f"{share:.0%} of the shots as made" + ("" if points is None else f" at {points:.2f} points each")
              for share, points in ((adoption.fired_before, adoption.scored_before),
                                    (adoption.fired_after, adoption.scored_after))]
    gained = "worth adopting (--adopt)" if adoption.low90 > 0.0 else "no clear gain or loss, if adopted (--adopt)"
    verdict = f"not adopted as found: {adoption.refused}" if adoption.refused else gained
    return (f"points on {adoption.shots} hold-out shots: aimed {adoption.aimed_before:.2f} -> "
            f"{adoption.aimed_after:.2f} per ball; the gate lets through {passed[0]} -> {passed[1]}; together "
            f"{adoption.gain:+.2f} per shot (90 %: {adoption.low90:+.2f} to {adoption.high90:+.2f}); {verdict}")


def _clear(further: FoundEffect) -> list[Named]:
    """Of its set, those whose sign is sure."""
    return [one for one in further.what if one.term in (further.set or ()) and one.size.low90 * one.size.high90 > 0.0]


def say_unknown(believed: tuple[str, ...], p_value: float, where: Where, leading: FoundEffect,
                also: Sequence[FoundEffect], fit: FitSummary, place: Place | None,
                among: Catalogue | None = None) -> str:
    """No term of the catalogue explains it; its shape all the same. also: the rest beside the nearest name."""
    withheld = isinstance(leading.withheld, str)
    said = f"{_missing(believed, among)} that no term of the catalogue explains."
    if withheld:
        said = f"{_missing(believed, among)} that cannot be named: {leading.withheld}."
    if leading.unknown is None or place is None:
        return said + _chance(p_value)
    stage = ""
    if where.stage and where.reason is None:
        likely = "most likely it happens" if where.stage == place.column.stage else "it may as well happen"
        stage = f"; {likely} {STAGE_WORDS[where.stage]}"
    falls_short = "explains it worse than a free curve does"
    if also:
        left = next((one.unknown.covariate for one in also if one.unknown is not None), None)
        falls_short = "leaves something of the kind over" + (f" that goes with {in_words(left)}" if left else "")
    nearest = ""
    if leading.what and not withheld:
        nearest = (f" The nearest name is {plain(leading.what[0].term, among)}, which {falls_short}; by it "
                   f"{say_name(leading.what[0], among, False)}.")
    return f"{said}{_looks(leading.unknown, place)}{stage}.{nearest}{_gained(fit)}{_chance(p_value)}"


def _looks(unknown: Unknown, place: Place) -> str:
    """How the real shots differ, and along with what."""
    words = place.column.words[unknown.amplitude < 0.0]
    size, name = _size(abs(unknown.amplitude), unknown.unit), in_words(unknown.covariate or "")
    if unknown.low90 is not None and unknown.high90 is not None:
        ends = (unknown.low90, unknown.high90) if unknown.amplitude >= 0.0 else (-unknown.high90, -unknown.low90)
        size += f" (90 %: {' to '.join(_size(end, unknown.unit) for end in ends)})"
    seen = f" Compared with it {words}"
    if isinstance(place.test.what, Factor):
        return f"{seen}, by up to {size}, depending on {name}"
    if isinstance(place.test.what, CovariatePair):
        first, second = in_words(place.test.what.first.name), in_words(place.test.what.second.name)
        return f"{seen}, by up to {size}, as {first} and {second} go together"
    if place.test.what is None:
        follows = place.column.follows
        return f"{seen}, by {size}, {f'along with {in_words(follows)}' if follows else 'in every shot alike'}"
    if place.test.shape.startswith(STEP):
        cut = place.test.shape.removeprefix(STEP)
        return f"{seen} where {name} is above {cut}, by {size}: a step, not a drift"
    return f"{seen} as {name} grows, by {size} over its range"


OPENINGS = {"none": "No mismatch: {} shots differ", "tracker": " Beside that no mismatch: {} shots differ",
            "blind": " They differ"}


def say_none(believed: tuple[str, ...], p_value: float | None, shots: int, false_alarm: float,
             among: Catalogue | None = None, opening: str = "none") -> str:
    """No mismatch, or nothing to see one by; opening: what the sentence begins with (`opening_of`)."""
    if p_value is None:
        return (f"These {shots} shots cannot say anything about the simulation: too few of them have a track, or an "
                "outcome or height, with distance and launch, that would tell; a test needs eight of like weight.")
    return (f"{OPENINGS[opening].format(shots)} from the simulation ({list_believed(believed, among)}) by no more than "
            f"chance. If nothing were missing, {say_chance(p_value)} (p = {p_value:.2g}, alarm at {false_alarm:g}).")


def say_scatter(off: float | None) -> str:
    """Say that times scatter by more than was stated, where they do; off: by how many standard deviations."""
    if off is None or off < WIDE:
        return ""
    return (f" But the times differ from it by {off:.2g} of their standard deviations (sigma_s): either they are less "
            "exact than stated, or something is missing that so few shots cannot show.")


def say_blind(blind: Sequence[TermIdentifiability], steps: Sequence[Mapping[str, Any]],
              among: Catalogue | None = None, opens: str = "") -> str:
    """Return what could not have been seen, and what would show it; empty where everything could. opens: what the
    sentence begins with where it is the first."""
    if not blind:
        return ""
    rest = f" and {len(blind) - SHOWN} others" if len(blind) > SHOWN else ""
    shown = ", ".join(f"measure {step['what']}" for step in steps)
    listed = ", ".join(_unseen(one, among) for one in blind[:SHOWN])
    best = f"; best next: {shown}" if shown else ""
    return f"{opens or ' These shots'} could not have shown {listed}{rest}{best}."


def _unseen(one: TermIdentifiability, among: Catalogue | None) -> str:
    """A term with the size below which it would have been missed more than one time in five."""
    if one.smallest is None:
        return f"{plain(one.term, among)} of any size"
    phrase = phrase_of(one.term, among)
    less = "slower than" if phrase is not None and phrase.rate else "below"      # a rate is told as its time constant
    return f"{plain(one.term, among)} {less} {size_of(one.term, one.smallest, one.unit, among)}"


def say_smallest(sight: Sight, among: Catalogue | None = None) -> str:
    """The smallest effects that would have been seen four times in five among all that was asked, of the terms that
    these data see best for their usual size."""
    terms = [one for one in sight.terms if one.smallest is not None]
    if not terms:
        return " Of no term could a test of these data have shown anything."
    parts = [f"{plain(one.term, among)} of {size_of(one.term, one.smallest or 0.0, one.unit, among)}"
             for one in sorted(terms, key=lambda one: (one.smallest or 0.0) / one.usual)[:SHOWN]]
    return f" Smallest effects that they would have shown, four times in five: {', '.join(parts)}."


def say_how_sure(finding: FindingRecord) -> str:
    """How often names were right that were as likely as this, where that was less often; measured in sealed rounds."""
    sure = bool(finding.what) and finding.what[0].probability >= TOO_SURE and finding.data.level == "L2"
    return "with tracks, 74 in 100 names said to be 99 % likely were right" if sure else ""


def console_lines(finding: FindingRecord, among: Catalogue | None = None) -> list[str]:
    """The verdict and a few lines below it."""
    data, where = finding.data, finding.where
    made = finding.mismatch.tests_made
    lines = [finding.sentence, f"{data.shots} shots, level {data.level}, {made} test{'s' * (made != 1)} over "
                               f"{data.clusters['count']} clusters ({data.clusters['by']})"]
    fitted = "fitted without it" if finding.mismatch.found else "fitted"
    lines += [f"{fitted}: {', '.join(f'{name} {value:.3g}' for name, value in values.items())}"
              for values in data.fitted.values() if values]
    if likely := [one for one in finding.what[:SHOWN] if one.probability >= LEAST_SHOWN]:
        pairs = " (two together count for both)" if sum(one.probability for one in likely) > 1.0 + LEAST_SHOWN else ""
        lines.append("names: " + ", ".join(f"{one.term} {one.probability:.0%}" for one in likely) + pairs
                     + "".join(f" ({said})" for said in [say_how_sure(finding)] if said))
    if finding.mismatch.found and where.stage_probability:
        lines.append("stages: " + ", ".join(f"{stage} {p:.0%}" for stage, p in where.stage_probability.items()))
    if where.inseparable:
        lines.append(say_inseparable(where))
    if finding.mismatch.found and where.times_s:
        lines.append(f"along the flight: {where.times_s[0]:.2f} to {where.times_s[1]:.2f} s")
    lines += [] if isinstance(finding.adoption, UnsetType) else [say_points(finding.adoption)]
    lines += [f"next: {say_step(step, among)}{then_measured(step, finding, among)}" for step in finding.next]
    if found := found_names(finding):
        lines.append(f"next: believe that and look again: --believe {','.join((*data.believed, *found))}")
    lines += [f"warning: {line}" for line in data.accepted]
    lines += [f"note: {line}" for line in data.notes]
    lines += [f"not tested: {line}" for line in data.untested]
    return lines + left_out_lines(data.left_out)


def say_inseparable(where: Where) -> str:
    """Which other columns could stand in the place of the covariate found."""
    others = ", ".join(map(in_words, where.inseparable))
    return f"{in_words(where.covariate or '')} goes with {others}: these data cannot tell them apart"


def say_step(step: dict[str, object], among: Catalogue | None = None) -> str:
    """The next step as text."""
    if step["do"] == "measure":
        return f"measure {step['what']}"
    names = step["separates"]
    assert isinstance(names, list)
    rpm = f" ({step['motor_rpm']} rpm)" if "motor_rpm" in step else ""
    return (f"{step['shots']} shots at {step['distance_m']:.3g} m, hood {step['hood_deg']:.3g}°, motor "
            f"{step['motor_ratio']:.3g}{rpm}, to tell {' from '.join(plain(name, among) for name in names)}")


def found_names(finding: FindingRecord) -> list[str]:
    """Names that stand alone, of a finding that compares with no earlier session: --believe takes no curves."""
    each = [(finding.what, finding.set), *((one.what, one.set) for one in finding.also)]
    alone = [what[0] for what, names in each if what and names is not None and len(names) == 1]
    named = (finding.verdict == "named" and ROOM.keys().isdisjoint(finding.data.believed)
             and all(one.believed is None for one in alone))
    return [one.term for one in alone if one.term not in finding.data.believed] if named else []


def then_measured(step: dict[str, object], finding: FindingRecord, among: Catalogue | None = None) -> str:
    """Which option takes what was measured of a name that competes; empty where the step measures none."""
    found = as_catalogue(among)
    terms = [term for name in finding.set or () if (term := found.get(name)) is not None]
    one = next((term for term in terms if term.instrument and term.instrument.id == step.get("instrument")), None)
    if one is None or step["do"] != "measure":
        return ""
    unit = {"1": ", as a share" if one.amplitude.percent else ""}.get(one.amplitude.unit, f", in {one.amplitude.unit}")
    return f"; then add --measured {one.name}=VALUE,SD ({one.amplitude.meaning}{unit})"


def _gained(fit: FitSummary) -> str:
    """The gain of the corrected simulation on hold-out shots."""
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
        before, after = _size(old, "m"), _size(new, "m")
        if before != after:
            parts[new < old].append(f"{where} within {after} instead of {before}")
    places = 3 if abs(fit.gain_per_shot or 0.0) < 10.0 else 0
    low, high = (f"{end:+.{places}f}" for end in interval)
    score = f"log score {fit.gain_per_shot:+.{places}f} per shot, 90 %: {low} to {high}"
    gain = f"forecasts {' and '.join(parts[True])}" if parts[True] else "does better"
    but = f", but forecasts {' and '.join(parts[False])}" if parts[False] else ""
    said = (f"scores worse ({score}): do not adopt it" if interval[1] < 0.0 else
            f"is not clearly better ({score})" if interval[0] <= 0.0 else f"{gain} ({score}){but}")
    return f" On hold-out shots the corrected simulation {said}."


def _missing(believed: tuple[str, ...], among: Catalogue | None) -> str:
    return f"The simulation ({list_believed(believed, among)}) leaves something out"


def say_chance(p_value: float) -> str:
    """Return how many of the datasets in which nothing is missing would look as extreme as this one.

    A p of the score test counts sign flips, and the data among them: below one in all of them it cannot fall.
    """
    if p_value > RARE:
        return f"{100.0 * p_value:.0f} datasets in 100 would look this extreme"
    least = "at most " if p_value * (1 + findings.SIGN_DRAWS) < 1.5 else ""
    return f"{least}1 dataset in {int(float(f'{1.0 / p_value:.2g}')):,} would look this extreme"


def _chance(p_value: float) -> str:
    return f" If nothing were missing, {say_chance(p_value)} (p = {p_value:.2g}, adjusted for all tests)."


def list_believed(names: Sequence[str], among: Catalogue | None = None) -> str:
    """Return believed terms as text; the room for what the model gets wrong comes last, as one."""
    room = ROOM.keys() <= {*names}
    named = [plain(name, among) for name in names if not (room and name in ROOM)]
    return ", ".join([*named, *["room for errors of the model"] * room])


def _size(amount: float, unit: str) -> str:
    if unit == "m" and amount >= 1.0:
        return f"{amount:.2g} m"
    factor, said = scale_of(unit)
    return f"{amount * factor:.2g}{said}"
