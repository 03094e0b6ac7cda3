"""A Tick as one flat row: dotted names, each with the unit that it ends in."""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import msgspec

from truearc.hw.protocols import ButtonEvent
from truearc.hw.reason import Reason, unit_of
from truearc.robot.reasons import text
from truearc.robot.types import Outcome, Tick

FLOAT, INT, BOOL, TEXT, TEXTS, FLOATS = "float", "int", "bool", "text", "texts", "floats"
Value = float | int | bool | str | Sequence[str] | Sequence[float] | None
Fill = Callable[[Any], list[Value]]

KINDS = {msgspec.inspect.FloatType: FLOAT, msgspec.inspect.IntType: INT, msgspec.inspect.BoolType: BOOL,
         msgspec.inspect.StrType: TEXT}
# What one of several, as many as there happen to be, is called
WORDS: dict[type, Callable[[Any], str]] = {
    ButtonEvent: lambda event: event.button,
    Reason: text,
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
        if isinstance(info, msgspec.inspect.StructType) and info.cls is Reason:
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
        return (Column(name, KINDS[type(info)], unit_of(name)),), lambda value: [value]

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
            return (Column(name, FLOATS, unit_of(name)),), lambda value: [[math.nan if part is None else part
                                                                          for part in value]]
        return (Column(name, FLOATS, unit_of(name)),), lambda value: [[part for item in value for part in item]]


def _joined(parts: list[tuple[tuple[Column, ...], Fill]],
            split: Callable[[Any], list[Any]]) -> tuple[tuple[Column, ...], Fill]:
    fills = [fill for _, fill in parts]

    def fill_all(value: Any) -> list[Value]:
        row: list[Value] = []
        for fill, part in zip(fills, split(value), strict=True):
            row += fill(part)
        return row

    return tuple(column for columns, _ in parts for column in columns), fill_all
