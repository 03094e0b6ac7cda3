"""How large an effect is, in a driver coach's words: per cent, degrees, centimetres, and which way."""

import math
import tomllib
from collections.abc import Mapping
from importlib.resources import files

from truearc.sim.discover.finding import Interval
from truearc.sim.physics.catalogue import Catalogue, as_catalogue
from truearc.sim.physics.nonparametric import Nameless
from truearc.sim.physics.term_fields import ANGLE, LENGTH, SHARE, Phrase

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
    size = (_time_constant if phrase.rate else _size)(interval.value * factor, low, high, phrase.unit)
    return (phrase.less if less else phrase.more).format(size)


def _size(value: float, low: float, high: float, unit: str) -> str:
    said, lowest, highest = _together(value, low, high)
    return f"{said}{unit} (90 %: {lowest} to {highest}{unit})"


def _time_constant(rate: float, low: float, high: float, unit: str) -> str:
    """The inverse of a rate, whose interval's ends swap; a rate that may be zero leaves it without an upper end."""
    if low > 0.0:
        return _size(1.0 / rate, 1.0 / high, 1.0 / low, unit)
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
