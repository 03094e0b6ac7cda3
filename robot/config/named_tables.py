"""Tables of launcher.toml whose structs depend on a name: [hood_encoder], and tables that other distributions define.

A distribution that reads values from another program, not from a device, has a table of its own. It registers a
ReadingTable under the table's name, which is loaded when a configuration contains that table:

    [project.entry-points."truearc.readings"]
    NAME = "package.module:TABLE"

truearc defines two keys of such a table, and the distribution defines all others. The key `vision` is a table, whose
presence means that a camera other than [camera] sees the target. The key `velocity` means that the robot reports its
own motion, and contains the numbers of `Driving`. A recording keeps the whole table as numbers and strings, and the
tick uses only `Driving`, so that a replay does not need the distribution.
"""

from collections.abc import Callable, Iterable
from functools import cache
from importlib.metadata import entry_points
from types import MappingProxyType
from typing import Any, Literal, NamedTuple, NoReturn

from msgspec import UNSET, Struct
from msgspec.structs import fields

from truearc.errors import ELSEWHERE, InputError, PluginError, load_plugin, only_point, place_of
from truearc.hw.devices import canandmag, registry
from truearc.hw.devices.family import Direction, EncoderFamily, Finite, HoodEncoder, driver_of
from truearc.hw.devices.spark.family import SPARK_ENCODER

# --- tables of other distributions

GROUP = "truearc.readings"


class ReadingTable(Struct, frozen=True, kw_only=True, eq=False):
    """One table of another distribution.

    name: of the table in launcher.toml.
    table: its struct, with `forbid_unknown_fields=True`.
    source: what reads it while the robot runs: makes a truearc.robot.eyes.Source of a Config.
    errors: key and objection of each value that cannot be, given the table and a Config.
    encoder: makes the EncoderFamily of a [hood_encoder] whose `driver` is this table's name, with the keys of
        ReadEncoder; None where it gives no angle.
    """

    name: str
    table: type[Struct]
    source: Callable[[Any], Any]
    errors: Callable[[Any, Any], Iterable[tuple[str, str]]] = lambda table, config: ()
    encoder: Callable[[], Any] | None = None


class Driving(NamedTuple):
    """What the tick must know of a robot that reports its motion, for shots on the move."""

    most_m_s: float                   # faster: HOLD
    pointing_deg: float               # the launcher may point this far off the lead
    delay_s: float = 0.0              # from a FIRE to when the ball leaves


def table_names() -> tuple[str, ...]:
    """Return the names of all installed tables without loading any."""
    return tuple(sorted({point.name for point in entry_points(group=GROUP)}))


def distribution_of_table(name: str) -> str:
    """Return the name of the distribution that has a table; raises as find_table does."""
    point = only_point(tuple(entry_points(group=GROUP, name=name)), name)
    return point.dist.name if point.dist else ""


@cache
def find_table(name: str) -> ReadingTable:
    """Return the table with this name.

    Raises:
        LookupError: no installed distribution has it.
        PluginError: its distribution is broken, or is not the only one with that name.
    """
    point = only_point(tuple(entry_points(group=GROUP, name=name)), name)
    found = load_plugin(point)
    if not isinstance(found, ReadingTable) or found.name != name:
        raise PluginError(f"{place_of(point)}: is not a ReadingTable called {name!r}")
    return found


def stated(value: Any) -> Any:
    """Return a struct as plain data, omitting optional keys that have their default."""
    if isinstance(value, tuple):
        return [stated(part) for part in value]
    if not isinstance(value, Struct):
        return value
    settings = value.__struct_config__
    tag = {settings.tag_field: settings.tag} if settings.tag_field else {}
    said = ((field, getattr(value, field.name)) for field in fields(value))
    return tag | {field.encode_name: stated(part) for field, part in said
                  if part is not UNSET and not (settings.omit_defaults and part == field.default)}


# --- hood encoders

FAMILIES: tuple[EncoderFamily[Any], ...] = (canandmag.CANANDMAG, SPARK_ENCODER, registry.MOTOR, registry.NONE)
BY_DRIVER = MappingProxyType({family.driver: family for family in FAMILIES})


class ReadEncoder(Struct, HoodEncoder, frozen=True, forbid_unknown_fields=True):
    """The hood's angle as another program publishes it, in each of its loops, even if it is unchanged."""

    driver: str                       # the table of launcher.toml that says where (truearc.readings)
    key: str
    unit: Literal["deg", "rad", "rev"]
    zero_deg: Finite                  # its value in degrees where the launch elevation is 0
    direction: Direction              # +1 if it grows with elevation


def _refuse(table: ReadEncoder, around: object) -> NoReturn:
    raise InputError(f"hood_encoder.driver: {table.driver!r} is of a distribution that is not installed")


# of a recording whose distribution is not installed: its angles are recorded, and nothing else is asked of it
RECORDED = EncoderFamily(
    driver="", table=ReadEncoder, example=ReadEncoder("", "", "deg", 0.0, 1), least_sigma_deg=0.0, make=_refuse,
    make_rules=lambda table, each_tick: (), questions=lambda table: (), examine=lambda table, around, heard: (),
    make_node=lambda table, plant, nodes: None, make_off_bus=_refuse)


def encoder_drivers() -> tuple[str, ...]:
    """Return every driver that [hood_encoder] may name, without loading a distribution."""
    return tuple(dict.fromkeys((*BY_DRIVER, *table_names())))


def encoder_table(driver: str, has_key: bool) -> type[HoodEncoder]:
    """Return the struct of [hood_encoder] with this driver; has_key: also with a key `key`.

    Raises:
        LookupError: there is no such driver. Any other distribution's reading may be in a recording.
    """
    if driver in BY_DRIVER or not (has_key or driver in ELSEWHERE or driver in table_names()):
        return BY_DRIVER[driver].table
    return ReadEncoder


def encoder_family_of(table: HoodEncoder) -> EncoderFamily[Any]:
    """Return the family of this table."""
    return _family_of(driver_of(table))


@cache
def _family_of(driver: str) -> EncoderFamily[Any]:
    if driver in BY_DRIVER:
        return BY_DRIVER[driver]
    try:
        make = find_table(driver).encoder
    except (LookupError, PluginError):
        return RECORDED
    return RECORDED if make is None else make()
