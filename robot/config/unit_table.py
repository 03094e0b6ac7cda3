"""Units by which columns end and that logs state, and how they convert."""

import math
import re

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
UNITS = {
    **{suffix: suffix for read, others in CONVERTED.items() for suffix in (read, *others)},
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), "m"),
    **dict.fromkeys(("in", "inch", "inches"), "in"), **dict.fromkeys(("ft", "foot", "feet"), "ft"),
    **dict.fromkeys(("cm", "centimeters"), "cm"), **dict.fromkeys(("mm", "millimeters"), "mm"),
    **dict.fromkeys(("yd", "yard", "yards"), "yd"),
    **dict.fromkeys(("deg", "degree", "degrees", "°"), "deg"),
    **dict.fromkeys(("rad", "rads", "radian", "radians"), "rad"),
    **dict.fromkeys(("rot", "rots", "rotation", "rotations", "rev"), "rev"),
    **dict.fromkeys(("rad/s", "rad_s", "rads", "radpersec", "radians per second", "rad per sec", "radianspersecond",
                     "radspersec", "rad/sec", "radpersecond"), "rad_s"),
    **dict.fromkeys(("rpm", "rotations per minute", "revolutions per minute", "rotationsperminute"), "rpm"),
    **dict.fromkeys(("rps", "rev/s", "rot/s", "rotations per second", "revolutions per second", "rotations/s", "rev_s",
                     "rotpersec", "rotationspersecond", "rotationspersec", "rotationpersecond"), "rps"),
    **dict.fromkeys(("deg/s", "deg_s", "degrees per second", "degpersec"), "deg_s"),
    **dict.fromkeys(("v", "volt", "volts"), "v"), **dict.fromkeys(("mv", "millivolts"), "mv"),
    **dict.fromkeys(("m/s", "m_s", "meters per second", "mps", "meterspersec", "meterspersecond"), "m_s"),
    **dict.fromkeys(("ft/s", "ft_s", "fps", "feet per second", "feetpersec"), "ft_s"),
    **dict.fromkeys(("s", "sec", "second", "seconds"), "s"), **dict.fromkeys(("ms", "milliseconds"), "ms"),
    **dict.fromkeys(("us", "microseconds"), "us"),
    **dict.fromkeys(("c", "celsius", "°c", "degc"), "c"), **dict.fromkeys(("f", "fahrenheit", "°f", "degf"), "f"),
}
REVOLUTION_DEG = 360.0
SUFFIX = re.compile(r"(radians?persec(?:ond)?|rad(?:s)?per?sec|rotations?per(?:sec(?:ond)?|minute)|deg(?:rees)?persec|"
                    r"meterspersec(?:ond)?|mps|rpm|rps|radians?|rads?|degrees?|degs?|rotations?|rots?|meters?|inches|"
                    r"feet|volts?|seconds?|_rad_s|_m_s|[ _](?:ft|in|cm|mm|yd|m|v|deg|rad))(/\d+|/value)?$",
                    re.IGNORECASE)
BRACKETS = re.compile(r"[(\[]\s*([^()\[\]]*?)\.?\s*[)\]]\s*$")


def unit_of(name: str) -> str:
    """The unit in which a column is read, "" where there is none of another: of exit_speed_m_s not the s, but m_s."""
    return max((unit for unit in CONVERTED if name.endswith("_" + unit)), key=len, default="")


def factor_of(column: str, unit: str) -> tuple[float, float] | None:
    """(how many of the column's unit are one of the other, its zero); None where it is not a unit of that column."""
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
    """The unit of a column of shots, "" for one without."""
    return "rad_s" if column == MOTOR or WHEEL.fullmatch(column) else unit_of(column)


def unit_in(key: str) -> str:
    """The unit that a key's name ends in, alone or in brackets, as UNITS has it; "" for none."""
    last = BRACKETS.search(key)
    if last and last[1].lower() in UNITS:
        return UNITS[last[1].lower()]
    found = SUFFIX.search((key[:last.start()] if last else key).rstrip())
    return UNITS.get(found[1].lower().lstrip("_ "), "") if found else ""
