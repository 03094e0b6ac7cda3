"""The schema of shots.toml, which states the keys and units of a team's log or table and how to find its shots."""

import math
import re
import tomllib
from collections.abc import Callable
from importlib.metadata import entry_points
from importlib.resources import files
from pathlib import Path
from typing import Any, Final, Literal

from msgspec import Struct, structs

from truearc.errors import InputError, load_text, make_toml, parse_struct

# --- units

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
                    r"feet|volts?|seconds?|_rad_s|_m_s|[ _](?:ft|in|cm|mm|yd|m|v|deg|rad))(/\d+|/value)?$",
                    re.IGNORECASE)
CAMEL = re.compile(r"(?<=[a-z])(MM|Mm|CM|Cm|IN|In|FT|Ft|YD|Yd|M|Deg|DEG|V|Ms|MS)$")      # DistanceMM
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


# --- the map

SCHEMA: Final = "truearc.shot-map/1"
MAPS = "truearc.maps"                 # entry points: packages with a shots.toml NAME.toml for each map
MEASURED = ("distance_m", "hood_deg", MOTOR, "battery_v")        # by a sensor each
NOT_MARKED = ("rejected", "")         # marks of shots that are to be left out
# outcome and side by the button that marks it
OUTCOMES = {"miss-low": ("miss", "low"), "two-low": ("two", "low"), "two": ("two", ""), "three": ("three", ""),
            "two-high": ("two", "high"), "miss-high": ("miss", "high")}
MARKS = {**OUTCOMES, "miss": ("miss", ""), "hit": ("hit", ""), "low": ("miss", "low"), "high": ("miss", "high"),
         **{f"miss-{side}": ("miss", side) for side in ("short", "long", "left", "right")}}


class Signal(Struct, frozen=True, forbid_unknown_fields=True):
    """A key of the log; its value is `times` x its number + `plus`, in the stated unit.

    unit: of the resulting number; by default what the log states, what the key ends in, or the column's own. alive, for
    advice: a key that changes in each loop of the robot's program; while it does, this one may stay constant.
    """

    key: str
    unit: str = ""
    times: float = 1.0
    plus: float = 0.0
    alive: str = ""


class Detection(Struct, frozen=True, forbid_unknown_fields=True):
    """How shots are found in a log of signals.

    wheel: the column of the signal whose dips are shots; by default the first wheel. set_point: of that speed. feed:
    above `feed_above` while balls are fed. least_dip: the smallest share of the speed that a ball takes.
    """

    wheel: str = ""
    set_point: str | Signal | None = None
    feed: str | Signal | None = None
    feed_above: float = 0.5
    least_dip: float = 0.01


class OutcomeKeys(Struct, frozen=True, forbid_unknown_fields=True):
    """How outcomes are determined: `key` takes one of `values`, or one of `buttons` is pressed, within `within_s` of
    the shot.

    Words: miss, two, three, hit, miss-low, two-high, ...; "rejected" omits the shot. otherwise: the word for shots
    without one; by default they are omitted.
    """

    key: str = ""
    values: dict[str, str] = {}
    buttons: dict[str, str] = {}
    within_s: float = 30.0
    otherwise: str = ""


class TimeColumn(Struct, frozen=True, forbid_unknown_fields=True):
    """The column of time in a CSV file."""

    column: str = "Timestamp"
    unit: Literal["s", "ms", "us"] = "s"


class ShotMap(Struct, frozen=True, forbid_unknown_fields=True):
    """A map of shots. rows: what a row of the file is: a time of a log, a shot, or a position of one ball (one file per
    shot)."""

    schema: Literal["truearc.shot-map/1"]
    rows: Literal["time", "shot", "position"] = "time"
    about: str = ""
    columns: dict[str, str | Signal] = {}
    time: TimeColumn = TimeColumn()
    shots: Detection = Detection()
    outcome: OutcomeKeys = OutcomeKeys()


def as_signal(said: str | Signal) -> Signal:
    """Return a signal; a key alone is one, too."""
    return Signal(said) if isinstance(said, str) else said


def plain(value: object) -> str:
    """Normalise a value for comparison: booleans, numbers without trailing zeros, lower-case text."""
    if isinstance(value, float):
        return f"{value:g}"
    return {"true": "1", "false": "0"}.get(str(value).strip().lower(), str(value).strip().lower())


def installed() -> dict[str, str]:
    """Texts by name, of truearc and of the packages that installed distributions name."""
    folders = (files("truearc.robot.config") / "maps", *(files(point.value) for point in entry_points(group=MAPS)))
    return {one.name.removesuffix(".toml"): one.read_text(encoding="utf-8")
            for one in sorted((one for folder in folders for one in folder.iterdir()), key=lambda one: one.name)
            if one.name.endswith(".toml")}


def load_map(name_or_path: str | Path, is_column: Callable[[str], bool] = lambda name: True) -> ShotMap:
    """Read a map from its path, or an installed one by its name; is_column: which columns shots may have.

    Raises:
        InputError: names file and key of what is unknown, or the maps that there are.
    """
    shipped = installed()
    if str(name_or_path) in shipped:
        return _read(shipped[str(name_or_path)], str(name_or_path), is_column)
    if not Path(name_or_path).exists():
        raise InputError(f"{name_or_path}: is neither a file nor an installed map ({', '.join(shipped)})")
    return _read(load_text(name_or_path), str(name_or_path), is_column)


def _read(text: str, name: str, is_column: Callable[[str], bool] = lambda name: True) -> ShotMap:
    found = parse_struct(text, ShotMap, name)
    known = {"position": ("t_s", "x_m", "y_m", "z_m")}.get(found.rows, ())
    for column, said in found.columns.items():
        if not (column in known or (not known and (column == MOTOR or is_column(column)))):
            there = ", ".join(known) if known else f"those of shots.csv, and {MOTOR}"
            raise InputError(f"{name}: columns.{column}: there is no such column ({there})")
        unit = as_signal(said).unit
        if unit and factor_of(column, unit) is None:
            raise InputError(f"{name}: columns.{column}.unit: {unit!r} is not a unit of {column}")
    numbers = {column: as_signal(said).key for column, said in found.columns.items() if column in MEASURED}
    for column, key in numbers.items():
        if other := next((one for one, same in numbers.items() if same == key and one != column), None):
            raise InputError(f"{name}: columns.{column} and columns.{other} have the same key, {key}")
    for key, word in (*found.outcome.values.items(), *found.outcome.buttons.items(),
                      ("otherwise", found.outcome.otherwise)):
        if word not in MARKS and word not in NOT_MARKED:
            raise InputError(f"{name}: outcome: {key} = {word!r}: is none of {', '.join(MARKS)}, rejected")
    return found


def to_toml(shot_map: ShotMap) -> str:
    """The text of a shots.toml that is read as this map."""
    return make_toml({"schema": SCHEMA, **_stated(shot_map)})


def _stated(value: Any) -> Any:
    """A struct as a table of the keys that are not as without a statement."""
    if isinstance(value, dict):
        return {key: _stated(part) for key, part in value.items()}
    return value if not isinstance(value, Struct) else {
        one.name: _stated(part) for one in structs.fields(value)
        if (part := getattr(value, one.name)) not in (one.default, {})}
