"""A tick as one flat row with a unit in each name, or as one topic per subsystem for viewers.

Viewers plot a topic's fields, which they find in the topic's schema. The schemas use only what all viewers support: an
object of numbers, booleans, strings and lists of one of these, without references, alternatives or null. An absent
value is omitted from its message, and a message without any value is not written.
"""

import math
import tomllib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from truearc.hw import protocols, reason
from truearc.robot.reasons import text
from truearc.robot.types import Outcome, Tick

FLOAT, INT, BOOL, TEXT, TEXTS, FLOATS = "float", "int", "bool", "text", "texts", "floats"
Value = float | int | bool | str | Sequence[str] | Sequence[float] | None
Fill = Callable[[Any], list[Value]]

KINDS = {msgspec.inspect.FloatType: FLOAT, msgspec.inspect.IntType: INT, msgspec.inspect.BoolType: BOOL,
         msgspec.inspect.StrType: TEXT}
# What one of several, as many as there happen to be, is called
WORDS: dict[type, Callable[[Any], str]] = {
    protocols.ButtonEvent: lambda event: event.button,
    reason.Reason: text,
    Outcome: lambda outcome: f"trial {outcome.trial} {outcome.outcome}",
}


class Column(NamedTuple):
    name: str                         # dotted; the parts of a tuple are counted from 0
    kind: str
    unit: str                         # "" for what has none


class FlatTicks:
    """Columns of a tick for this number of flywheel motors; `row` gives a value, or None, for each column."""

    def __init__(self, flywheels: int) -> None:
        self._flywheels = flywheels
        self.columns, self.row = self._lay(msgspec.inspect.type_info(Tick), "")

    def _lay(self, info: msgspec.inspect.Type, name: str) -> tuple[tuple[Column, ...], Fill]:
        if isinstance(info, msgspec.inspect.UnionType):
            inner = next(kind for kind in info.types if not isinstance(kind, msgspec.inspect.NoneType))
            return self._maybe(inner, name)
        if isinstance(info, msgspec.inspect.StructType) and info.cls is reason.Reason:
            return (Column(name, TEXT, ""),), lambda value: [text(value)]
        if isinstance(info, msgspec.inspect.StructType):
            parts = [(field.name, self._field(field, f"{name}.{field.name}" if name else field.name))
                     for field in info.fields]
            return _joined([part for _, part in parts],
                           lambda value: [getattr(value, attribute) for attribute, _ in parts])
        if isinstance(info, msgspec.inspect.TupleType):
            return _joined([self._lay(kind, f"{name}.{at}") for at, kind in enumerate(info.item_types)], list)
        if isinstance(info, msgspec.inspect.VarTupleType):
            return self._several(info.item_type, name)
        return (Column(name, KINDS[type(info)], reason.unit_of(name)),), lambda value: [value]

    def _field(self, field: msgspec.inspect.Field, name: str) -> tuple[tuple[Column, ...], Fill]:
        """Of one that may be left out altogether, too."""
        is_optional = not field.required and field.default is field.default_factory      # both: there is none
        return (self._maybe if is_optional else self._lay)(field.type, name)

    def _maybe(self, info: msgspec.inspect.Type, name: str) -> tuple[tuple[Column, ...], Fill]:
        columns, fill = self._lay(info, name)
        nothing: list[Value] = [None] * len(columns)
        return columns, lambda value: nothing if value is None or value is msgspec.UNSET else fill(value)

    def _several(self, info: msgspec.inspect.Type, name: str) -> tuple[tuple[Column, ...], Fill]:
        if isinstance(info, msgspec.inspect.StructType) and info.cls not in WORDS:
            return _joined([self._lay(info, f"{name}.{at}") for at in range(self._flywheels)], list)
        if isinstance(info, msgspec.inspect.StructType):
            word = WORDS[info.cls]
            return (Column(name, TEXTS, ""),), lambda value: [[word(item) for item in value]]
        if isinstance(info, msgspec.inspect.StrType):
            return (Column(name, TEXTS, ""),), lambda value: [list(value)]
        if isinstance(info, msgspec.inspect.UnionType | msgspec.inspect.FloatType):
            return (Column(name, FLOATS, reason.unit_of(name)),), lambda value: [[math.nan if part is None else part
                                                                          for part in value]]
        return (Column(name, FLOATS, reason.unit_of(name)),), lambda value: [[part for item in value for part in item]]


def _joined(parts: list[tuple[tuple[Column, ...], Fill]],
            split: Callable[[Any], list[Any]]) -> tuple[tuple[Column, ...], Fill]:
    fills = [fill for _, fill in parts]

    def fill_all(value: Any) -> list[Value]:
        row: list[Value] = []
        for fill, part in zip(fills, split(value), strict=True):
            row += fill(part)
        return row

    return tuple(column for columns, _ in parts for column in columns), fill_all


# --- topics by subsystem

TYPES = {FLOAT: "number", INT: "integer", BOOL: "boolean", TEXT: "string"}
LISTS = {TEXTS: "string", FLOATS: "number"}
CLOCK = "unit: ns, on the robot's own clock; 0 means never"
UNITLESS = {FLOAT: "unit: 1", INT: "unit: 1", FLOATS: "unit: 1", BOOL: "true or false", TEXT: "text", TEXTS: "texts"}

VIEWER: dict[str, Any] = tomllib.loads(Path(__file__).with_name("viewer.toml").read_text(encoding="utf-8"))
FLYWHEEL = "inputs.flywheels."


class Topic(NamedTuple):
    """One topic: its name, the JSON schema of its messages, and (place in a flat tick, kind, field) of each field."""

    name: str
    schema: dict[str, Any]
    fields: tuple[tuple[int, str, str], ...]

    def message(self, row: list[Value]) -> bytes | None:
        """Return the JSON of one flat tick; None if every value is absent. A list that lacks a number is omitted
        entirely."""
        found = {field: row[at] for at, kind, field in self.fields if _is_there(kind, row[at])}
        return msgspec.json.encode(found) if found else None


def topics_of(columns: tuple[Column, ...]) -> Iterator[Topic]:
    """Return the topics of a flat tick with these columns."""
    motors = dict.fromkeys(column.name.removeprefix(FLYWHEEL).partition(".")[0] for column in columns
                           if column.name.startswith(FLYWHEEL))
    flywheels = {f"/flywheels/motor_{motor}": (f"flywheel motor {motor} as last heard", f"{FLYWHEEL}{motor}.")
                 for motor in motors}
    for name, (what, *prefixes) in (flywheels | VIEWER["topics"]).items():
        fields = {_field(column.name, prefix): (at, column) for prefix in prefixes
                  for at, column in enumerate(columns)
                  if column.name == prefix or (prefix.endswith(".") and column.name.startswith(prefix))}
        yield Topic(name, object_schema(f"truearc{name.replace('/', '.')}", what,
                                        {field: _property(column) for field, (_, column) in fields.items()}),
                    tuple((at, column.kind, field) for field, (at, column) in fields.items()))


def object_schema(title: str, what: str, properties: dict[str, Any]) -> dict[str, Any]:
    return {"title": title, "description": what, "type": "object", "properties": properties}


def _field(column: str, prefix: str) -> str:
    return column.removeprefix(prefix).replace(".", "_") or column.rpartition(".")[2]


def _property(column: Column) -> dict[str, Any]:
    said = CLOCK if column.unit == "ns" else f"unit: {column.unit}" if column.unit else UNITLESS[column.kind]
    if column.kind in LISTS:
        return {"type": "array", "items": {"type": LISTS[column.kind]}, "description": said}
    return {"type": TYPES[column.kind], "description": said}


def _is_there(kind: str, value: Value) -> bool:
    if value is None:
        return False
    return kind != FLOATS or all(map(math.isfinite, value))     # type: ignore[arg-type]
