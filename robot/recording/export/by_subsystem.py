"""Ticks by subsystem: the topics of an exported MCAP, their JSON schemas with units, and their messages.

Viewers plot a topic's fields, which they find in its schema. The schemas keep to what all of them read: an object of
numbers, truth values, texts and lists of one of these; no references, no alternatives, no null. A value that is absent
is left out of its message, and a message without any value is not written.
"""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import msgspec

from truearc.robot.recording.export.tabular import BOOL, FLOAT, FLOATS, INT, TEXT, TEXTS, Column, Value

TYPES = {FLOAT: "number", INT: "integer", BOOL: "boolean", TEXT: "string"}
LISTS = {TEXTS: "string", FLOATS: "number"}
CLOCK = "unit: ns, on the robot's own clock; 0 means never"
UNITLESS = {FLOAT: "unit: 1", INT: "unit: 1", FLOATS: "unit: 1", BOOL: "true or false", TEXT: "text", TEXTS: "texts"}

# topic -> what it is, and the columns of a flat tick that it has: those that begin so, or one by its whole name
TOPICS = {
    "/hood/motor": ("hood motor as last heard", ("inputs.hood_motor.",)),
    "/hood/encoder": ("hood's absolute encoder as last heard", ("inputs.hood_angle.",)),
    "/feeder": ("feeder motor as last heard", ("inputs.feeder.",)),
    "/camera/sighting": ("what vision made of an image; distance from the lens to the target plane, bearing of the "
                         "target to the right positive", ("inputs.sighting.",)),
    "/battery": ("battery", ("estimate.battery_v",)),
    "/estimate": ("state of the launcher as believed; distance from the ball's exit to the target plane",
                  ("estimate.",)),
    "/aim": ("set points", ("aim.",)),
    "/verdict": ("FIRE or HOLD, and why", ("verdict.",)),
    "/command": ("torques that the tick requested, at the motor shaft", ("command.",)),
    "/sent": ("torques that went out after all limits", ("sent.",)),
    "/operator": ("what the driver did, and how the robot stands", (
        "inputs.buttons", "memory.armed", "memory.homed", "memory.trial", "memory.request_t_ns", "memory.feed_t_ns",
        "memory.awaiting")),
    "/faults": ("wires lost, frames refused, presses missed", ("inputs.faults", "inputs.missed", "inputs.unseen")),
    "/shot": ("one ball fed, as known at that moment", ("shot.",)),
}
FLYWHEEL = "inputs.flywheels."


class Topic(NamedTuple):
    """One topic: its name, the JSON schema of its messages, and (place in a flat tick, kind, field) of each field."""

    name: str
    schema: dict[str, Any]
    fields: tuple[tuple[int, str, str], ...]

    def message(self, row: list[Value]) -> bytes | None:
        """JSON of one flat tick; None where every value is absent. A list that lacks a number is left out whole."""
        found = {field: row[at] for at, kind, field in self.fields if _is_there(kind, row[at])}
        return msgspec.json.encode(found) if found else None


def topics_of(columns: tuple[Column, ...]) -> Iterator[Topic]:
    """The topics that a flat tick of these columns has."""
    motors = dict.fromkeys(column.name.removeprefix(FLYWHEEL).partition(".")[0] for column in columns
                           if column.name.startswith(FLYWHEEL))
    flywheels = {f"/flywheels/motor_{motor}": (f"flywheel motor {motor} as last heard", (f"{FLYWHEEL}{motor}.",))
                 for motor in motors}
    for name, (what, prefixes) in (flywheels | TOPICS).items():
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
