"""The schema of shots.toml, which states the keys and units of a team's log or table and how to find its shots."""

from collections.abc import Callable
from importlib.metadata import entry_points
from importlib.resources import files
from pathlib import Path
from typing import Any, Final, Literal

from msgspec import Struct, structs

from truearc.errors import InputError, load_text, make_toml, parse_struct
from truearc.robot.config.units import MOTOR, factor_of

SCHEMA: Final = "truearc.shot-map/1"
MAPS = "truearc.maps"                 # entry points: packages with a shots.toml NAME.toml for each map
MEASURED = ("distance_m", "hood_deg", MOTOR, "battery_v")        # by a sensor each
NOT_MARKED = ("rejected", "")         # marks of shots that are to be left out
# outcome and side by the button that marks it
OUTCOMES = {"miss-low": ("miss", "low"), "two-low": ("two", "low"), "two": ("two", ""), "three": ("three", ""),
            "two-high": ("two", "high"), "miss-high": ("miss", "high"), "miss-left": ("miss", "left"),
            "miss-right": ("miss", "right")}
MARKS = {**OUTCOMES, "miss": ("miss", ""), "hit": ("hit", ""), "low": ("miss", "low"), "high": ("miss", "high"),
         **{f"miss-{side}": ("miss", side) for side in ("short", "long")}}


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
