"""Names, sizes and steps of a finding in words; `story` puts them into sentences."""

import math
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files

from msgspec import UnsetType

from truearc.sim.discover import finding as findings
from truearc.sim.discover.finding import FindingRecord, Interval, Named, Where
from truearc.sim.infer.room import ROOM
from truearc.sim.physics.catalogue import Catalogue, Nameless, as_catalogue
from truearc.sim.physics.term import ANGLE, LENGTH, SHARE, Phrase

MOST_PLACES = 5                       # after the point; beyond, exponents
WORDING = tomllib.loads((files("truearc.sim.discover.report") / "wording.toml").read_text(encoding="utf-8"))
COLUMNS: dict[str, str] = WORDING["columns"]
UNITS = (("rad_s", "rad/s"), ("rev_s", "rev/s"), ("m_s", "m/s"), ("deg", "°"), ("m2_kg", "m²/kg"), ("kg", "kg"),
         ("pa", "Pa"), ("ratio", "of full"), ("v", "V"), ("c", "°C"), ("m", "m"), ("s", "s"))


def in_words(column: str) -> str:
    """A column as people say it; one that is the user's own: by its name, and so are two together."""
    return " x ".join(COLUMNS.get(one, one) for one in column.split(" x "))


def part_unit(column: str) -> tuple[str, str]:
    """Return a column's name without its unit, and the unit as people write it; "" where the name ends in none."""
    for unit, said in UNITS:
        if column.endswith(f"_{unit}"):
            return column.removesuffix(f"_{unit}"), said
    return column, ""


def say_improbable(numbers: Mapping[str, float]) -> str:
    """Say that fitted numbers were believed all but impossible; empty without any."""
    if not numbers:
        return ""
    found = " and ".join(f"{name} {value:.3g}" for name, value in numbers.items())
    tracker = all(name.startswith("track_") for name in numbers)
    what = f"{'the tracker may be as wrong as that, or ' * tracker}an effect may be there that they cannot tell from it"
    return f" The fit has {found}, believed all but impossible before these shots: {what}."


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


# Chosen: twice FALSE_ALARM
RARE = 0.1                            # p up to which it is stated as one dataset in how many
# Derived: their mean square is 4, of ten by chance once in 10^5
WIDE = 2.0                            # standard deviations by which times differ: chance hardly does that to ten


def either(names: Sequence[str], last: str = "or") -> str:
    """Names as a list, such as "a, b or c"."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} {last} {names[-1]}"


SAME_TRACKER = (" The tracker's calibration as fitted was compared with the earlier session's: beside what is named "
                "here no change is seen.")


def say_limits(at_limit: Mapping[str, float]) -> str:
    """Return a sentence about fitted numbers that stopped at the end of their range; empty where none did."""
    if not at_limit:
        return ""
    found = ", ".join(f"{name} at {value:.4g}" for name, value in at_limit.items())
    return f" A fit stopped at the end of a range ({found}): what it stands for may be something else."


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


def say_scatter(off: float | None) -> str:
    """Say that times scatter by more than was stated, where they do; off: by how many standard deviations."""
    if off is None or off < WIDE:
        return ""
    return (f" The times differ from the simulation by {off:.2g} of their standard deviations (sigma_s): either they "
            "are less exact than stated, or something is missing that so few shots cannot show.")


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


def say_chance(p_value: float) -> str:
    """Return how many of the datasets in which nothing is missing would look as extreme as this one.

    A p of the score test counts sign flips, and the data among them: below one in all of them it cannot fall.
    """
    if p_value > RARE:
        return f"{100.0 * p_value:.0f} datasets in 100 would look this extreme"
    least = "at most " if p_value * (1 + findings.SIGN_DRAWS) < 1.5 else ""
    often = f"{int(float(f'{1.0 / p_value:.2g}')):,}" if p_value > 0.0 else "many"
    return f"{least}1 dataset in {often} would look this extreme"


def list_believed(names: Sequence[str], among: Catalogue | None = None) -> str:
    """Return believed terms as text; the room for what the model gets wrong comes last, as one."""
    room = ROOM.keys() <= {*names}
    named = [plain(name, among) for name in names if not (room and name in ROOM)]
    return ", ".join([*named, *["room for errors of the model"] * room])
