"""Units of columns and keys: the endings of names that state them, and the factors that convert between units.

`units.toml` lists the words that logs use for a unit. SI units and degrees are the units of a dataset's columns.
"""

import math
import re
import tomllib
from pathlib import Path

MOTOR = "motor_rad_s"                 # of a map: the motors' speed, which becomes motor_ratio by the rig's free speed
WHEEL = re.compile(r"wheel_(.+)_rad_s")

# unit that is read -> suffix of another one -> how many of the first are one of the second
CONVERTED = {
    "m": {"mm": 1e-3, "cm": 0.01, "in": 0.0254, "ft": 0.3048, "yd": 0.9144},
    "s": {"ms": 1e-3, "us": 1e-6},
    "deg": {"rad": 180.0 / math.pi},
    "rad_s": {"rpm": math.pi / 30.0, "rev_s": 2.0 * math.pi, "rps": 2.0 * math.pi, "deg_s": math.pi / 180.0},
    "rev_s": {"rpm": 1.0 / 60.0, "rps": 1.0, "rad_s": 0.5 / math.pi},
    "m_s": {"ft_s": 0.3048, "in_s": 0.0254, "mph": 0.44704, "km_h": 1.0 / 3.6},
    "kg": {"g": 1e-3, "lb": 0.45359237, "oz": 0.028349523125},
    "v": {"mv": 1e-3},
    "pa": {"hpa": 100.0, "kpa": 1000.0},
    "c": {"k": 1.0, "f": 5.0 / 9.0},
}
ZERO = {"k": 273.15, "f": 32.0}       # in that unit, of a unit that is read; of others 0
# what logs call units -> as columns of a dataset end
UNITS = {suffix: suffix for read, others in CONVERTED.items() for suffix in (read, *others)}
UNITS |= {word: unit for unit, words in tomllib.loads(
    Path(__file__).with_name("units.toml").read_text(encoding="utf-8")).items() for word in words}
NOUNS = {"m": "distance", "s": "time", "deg": "angle", "rad_s": "speed"}            # of keys that are units alone
REVOLUTION_DEG = 360.0
WORD = re.compile(r"[A-Z]+s?(?![a-z])|[A-Z]?[a-z]+|[/°]")
LETTERS = set("mvscf")                # that are units alone, of a word of its own as in DistanceM
# units that end a word of small letters
GLUED = re.compile(r"(?:(?:rad(?:ian)?s?|deg(?:ree)?s?|rot(?:ation)?s?|met(?:er|re)s?|feet)"
                   r"(?:per(?:sec(?:ond)?|minute))?|rpm|[rfm]ps|mph|inches|volts?|seconds?)$", re.IGNORECASE)
PLACE = re.compile(r"(?:/\d+|/value)$")                   # behind a key of a log
SPEEDS, TILTS = {"speed", "velocity", "vel"}, {"angle", "hood", "pitch", "pivot", "tilt", "elevation"}
BRACKETS = re.compile(r"[(\[]\s*([^()\[\]]*?)\.?\s*[)\]]\s*$")


def unit_of(name: str) -> str:
    """Return the unit in which a column is read, "" if it has no other: for exit_speed_m_s not s, but m_s."""
    return max((unit for unit in CONVERTED if name.endswith("_" + unit)), key=len, default="")


def called(text: str) -> str:
    """Return the unit that a text is, as columns end in it: m_s for m/s, mps and meters per second; "" for none."""
    text = text.strip().lower()
    parts = re.findall(r"[^\W_]+|°", text.replace("per", " ").replace("rads", "rad"))
    return UNITS.get(text) or UNITS.get("_".join(UNITS.get(part, part) for part in parts), "")


def factor_of(column: str, unit: str) -> tuple[float, float] | None:
    """Return (number of the column's unit per unit of the other, zero offset); None if it is not a unit of that
    column."""
    read, other = own_unit(column), called(unit)
    if not other:
        return None
    if other == read or (read == "rev_s" and other == "rps"):
        return 1.0, 0.0
    if read == "deg" and other == "rev":
        return REVOLUTION_DEG, 0.0
    factor = CONVERTED.get(read, {}).get(other)
    return None if factor is None else (factor, ZERO.get(other, 0.0))


def own_unit(column: str) -> str:
    """Return the unit of a column of shots, "" if it has none."""
    return "rad_s" if column == MOTOR or WHEEL.fullmatch(column) else unit_of(column)


def _meant(unit: str, key: str) -> str:
    """What a unit is in a key of that name: no speed is in milliseconds, and no angle in radians per second."""
    said = {word.lower() for word in WORD.findall(key)}
    if said & SPEEDS:
        return "m_s" if unit == "ms" else unit
    return "" if unit == "in_s" else "rad" if unit == "rad_s" and said & TILTS and "per" not in said else unit


def _ending(key: str) -> tuple[int, str]:
    """Where the unit at the end of a key's name begins, and which it is; "" for none."""
    end = len(PLACE.sub("", key.rstrip()))
    words = [*WORD.finditer(key, 0, end)]
    for word in words[-4:] if words and words[-1].end() == end else ():
        text = key[word.start():end]
        if (unit := _meant(called(text), key)) and (len(text) > 1 or text.lower() in LETTERS):
            return word.start(), unit
    glued = GLUED.search(key, 0, end)
    return (glued.start(), _meant(called(glued[0]), key)) if glued else (len(key), "")


def unit_in(key: str) -> str:
    """Return the unit at the end of a key's name, alone or in brackets, as in UNITS; "" for none."""
    last = BRACKETS.search(key)
    return (_meant(called(last[1]), key) if last else "") or _ending(key[:last.start()] if last else key)[1]


def in_unit(key: str, unit: str) -> str:
    """Return the name of a key whose numbers are in another unit: Dist (in) for Dist (ft), distance_in for distance_m,
    speed (rad_s) for RPM."""
    last = BRACKETS.search(key)
    if last and last.start() and called(last[1]):
        return f"{key[:last.start(1)]}{unit}{key[last.end(1):]}"
    start, own = _ending(key)
    if own and key[:start].endswith("_"):
        return f"{key[:start]}{unit}"
    noun = next((NOUNS.get(read, "") for read, others in CONVERTED.items() if unit in (read, *others)), "") or "number"
    return f"{('' if last and not last.start() else key[:start].rstrip()) or noun} ({unit})"
