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
SUFFIX = re.compile(r"(radians?persec(?:ond)?|rad(?:s)?per?sec|rotations?per(?:sec(?:ond)?|minute)|deg(?:rees)?persec|"
                    r"meterspersec(?:ond)?|mps|rpm|rps|radians?|rads?|degrees?|degs?|rotations?|rots?|meters?|inches|"
                    r"feet|volts?|seconds?|_(?:rad|m|ft)_s|[ _](?:ft|in|cm|mm|yd|m|v|deg|rad))(/\d+|/value)?$",
                    re.IGNORECASE)
CAMEL = re.compile(r"(?<=[a-z])(MM|Mm|CM|Cm|IN|In|FT|Ft|FtS|YD|Yd|M|Deg|DEG|V|Ms|MS)$")      # DistanceMM
BRACKETS = re.compile(r"[(\[]\s*([^()\[\]]*?)\.?\s*[)\]]\s*$")


def unit_of(name: str) -> str:
    """Return the unit in which a column is read, "" if it has no other: for exit_speed_m_s not s, but m_s."""
    return max((unit for unit in CONVERTED if name.endswith("_" + unit)), key=len, default="")


def factor_of(column: str, unit: str) -> tuple[float, float] | None:
    """Return (number of the column's unit per unit of the other, zero offset); None if it is not a unit of that
    column."""
    read, other = own_unit(column), UNITS.get(unit.strip().lower())
    if other is None:
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


def unit_in(key: str) -> str:
    """Return the unit at the end of a key's name, alone or in brackets, as in UNITS; "" for none."""
    last = BRACKETS.search(key)
    if last and last[1].lower() in UNITS:
        return UNITS[last[1].lower()]
    plain = (key[:last.start()] if last else key).rstrip()
    found = SUFFIX.search(plain) or CAMEL.search(plain)
    return UNITS.get(found[1].lower().lstrip("_ "), "") if found else ""


def in_unit(key: str, unit: str) -> str:
    """Return the name of a key whose numbers are in another unit: Dist (in) for Dist (ft), distance_in for distance_m,
    speed (rad_s) for RPM."""
    last = BRACKETS.search(key)
    if last and last.start() and last[1].lower() in UNITS:
        return f"{key[:last.start(1)]}{unit}{key[last.end(1):]}"
    if own := max((one for one in UNITS if key.lower().endswith(f"_{one}")), key=len, default=""):
        return f"{key.removesuffix(key[-len(own):])}{unit}"
    found = SUFFIX.search(key) or CAMEL.search(key)
    noun = next((NOUNS.get(read, "") for read, others in CONVERTED.items() if unit in (read, *others)), "") or "number"
    return f"{(key[:found.start()].rstrip() if found else '' if last and not last.start() else key) or noun} ({unit})"
