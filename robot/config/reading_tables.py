"""Tables of launcher.toml that other distributions own: what another program, not a device, lets the robot read.

A distribution registers a ReadingTable under the name of its table, and it is loaded when a configuration has that
table:

    [project.entry-points."truearc.readings"]
    NAME = "package.module:TABLE"

Two keys of such a table are truearc's own. `vision`, a table, says that another camera sees the target instead of
[camera]. `velocity` says that the robot tells how it drives, and has the numbers of `Driving`. All the rest is the
distribution's. A recording keeps the whole table as numbers and texts, and the tick uses `Driving` alone, so that a
replay does without the distribution.
"""

from collections.abc import Callable, Iterable
from functools import cache
from importlib.metadata import entry_points
from typing import Any, NamedTuple

from msgspec import UNSET, Struct
from msgspec.structs import fields

from truearc.errors import PluginError, load_plugin, only_point, place_of

GROUP = "truearc.readings"


class ReadingTable(Struct, frozen=True, kw_only=True, eq=False):
    """One table of another distribution.

    name: of the table in launcher.toml.
    table: its struct, with `forbid_unknown_fields=True`.
    source: what reads it while the robot runs: makes a truearc.robot.readings.Source of a Config.
    errors: key and objection of each value that cannot be, given the table and a Config.
    encoder: makes the EncoderFamily of a [hood_encoder] whose `driver` is this table's name, with the keys of
        truearc.robot.hood_encoders.ReadEncoder; None where it gives no angle.
    """

    name: str
    table: type[Struct]
    source: Callable[[Any], Any]
    errors: Callable[[Any, Any], Iterable[tuple[str, str]]] = lambda table, config: ()
    encoder: Callable[[], Any] | None = None


class Driving(NamedTuple):
    """What the tick must know of a robot that tells how it drives, for shots on the move."""

    most_m_s: float                   # faster: HOLD
    pointing_deg: float               # the launcher may point this far beside the lead
    delay_s: float = 0.0              # from a FIRE to when the ball leaves


def table_names() -> tuple[str, ...]:
    """Names of all installed tables; none of them is loaded."""
    return tuple(sorted({point.name for point in entry_points(group=GROUP)}))


def distribution_of_table(name: str) -> str:
    """Name of the distribution that has a table; raises as find_table."""
    point = only_point(tuple(entry_points(group=GROUP, name=name)), name)
    return point.dist.name if point.dist else ""


@cache
def find_table(name: str) -> ReadingTable:
    """The table of this name.

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
    """A struct as plain data, and what is in it; a key that may be left out and has its default is left out."""
    if isinstance(value, tuple):
        return [stated(part) for part in value]
    if not isinstance(value, Struct):
        return value
    settings = value.__struct_config__
    tag = {settings.tag_field: settings.tag} if settings.tag_field else {}
    said = ((field, getattr(value, field.name)) for field in fields(value))
    return tag | {field.encode_name: stated(part) for field, part in said
                  if part is not UNSET and not (settings.omit_defaults and part == field.default)}
