"""Errors in a TOML file: msgspec's messages reworded, and the line of the key that they name."""

import re
from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any

from msgspec import Struct
from msgspec.structs import fields

from truearc.hw.devices.axis import Axis, HoodEncoder

KINDS = {"float": "a number", "int": "a whole number", "str": "a text in quotes", "bool": "true or false",
         "object": "a table", "array": "a list", "null": "nothing"}
LIMITS = {">=": "of at least", "<=": "of at most", ">": "above", "<": "below"}
LONGEST = 40                          # characters of a text that are shown

_INNER_PLACE = re.compile(r" - at `\$([^`]*)` - at `\$([^`]*)`$")      # of an axis's key, and of the axis


def joined(message: str) -> str:
    """A message with the place of an axis's key behind that of its axis."""
    return _INNER_PLACE.sub(r" - at `$\2\1`", message)


def reworded(message: str, table: Any = None) -> str:
    """msgspec's message in plain words, behind the key that it is about; table: what was decoded, for the value."""
    what, _, place = message.partition(" - at `")
    key = place.strip("$.`")
    if field := re.fullmatch(r"Object (contains unknown|missing required) field `(.*)`", what):
        return f"{key}.{field[2]}".lstrip(".") + (": unknown key" if "unknown" in field[1] else ": missing key")
    value = _at(table, key)
    got = f"the text {value[:LONGEST]!r}" if isinstance(value, str) else str(value).lower()
    if wanted := re.fullmatch(r"Expected `(.*?)(?: \| null)?`(.*?)(?:, got `?(\w+)`?)?", what):
        kind, limit = KINDS.get(wanted[1], wanted[1]), wanted[2]
        for sign, words in LIMITS.items():
            limit = limit.replace(f" {sign} ", f" {words} ").replace("length of", "length")
        if value is None or isinstance(value, list | dict):
            got = KINDS.get(wanted[3], wanted[3])
        what = f"{kind}{limit} is expected" + (f", got {got}" if got else "")
        if isinstance(value, str) and "number" in kind and re.fullmatch(r"[+-]?\d+([.,]\d+)?", value):
            what += f"; write {value.replace(',', '.')} without quotes"
    elif unknown := re.fullmatch(r"Invalid (?:enum )?value (.*)", what):
        what = f"{unknown[1]} is not known here" + (f"; there are {', '.join(there)}" if (there := _known(key)) else "")
    return f"{key}: {what}" if key else what


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return `; did you mean ...?` for the nearest of the known words; "" where none is near."""
    return "".join(f"; did you mean {near}?" for near in get_close_matches(word, list(known), 1))


def near_key(key: str, kind: Any, table: Any) -> str:
    """did_you_mean for a dotted key that a file of the struct `kind`, decoded as `table`, does not have."""
    *above, name = key.split(".")
    for number, part in enumerate(above, 1):
        types = {one.name: one.type for one in fields(kind)} if kind is not None else {}
        annotation = types.get(re.sub(r"\[.*?\]", "", part))
        kind = struct_in(annotation) or device_in(annotation, _at(table, ".".join(above[:number])))
    return "" if kind is None else did_you_mean(name, kind.__struct_fields__)


def near_tables(table: Any, kind: Any, prefix: str = "") -> str:
    """`; [PLACE] is unknown; did you mean ...?` for each table that the struct `kind` does not have but nearly has."""
    own, said = {one.encode_name: struct_in(one.type) for one in fields(kind)}, ""
    for name, value in table.items():
        if isinstance(value, dict | list) and name not in own and (near := did_you_mean(name, own)):
            said += f"; [{prefix}{name}] is unknown{near}"
        elif isinstance(value, dict) and own.get(name) is not None:
            said += near_tables(value, own[name], f"{prefix}{name}.")
    return said


def device_in(annotation: Any, table: Any) -> Any:
    """The struct of a device's table, by its driver, where the field's annotation is about axes or the hood's encoder;
    None where it is not, and where there is no such driver that works."""
    from truearc.hw.plugins import PluginError
    driver = table.get("driver") if isinstance(table, dict) else None
    kind = _device(annotation)
    try:
        return table_of(kind, driver) if kind is not None and isinstance(driver, str) else None
    except (LookupError, PluginError):
        return None


def _device(annotation: Any) -> Any:
    if annotation in (Axis, HoodEncoder):
        return annotation
    return next(filter(None, map(_device, getattr(annotation, "__args__", ()))), None)


def table_of(kind: Any, driver: str) -> Any:
    """The struct of a device's table, by its driver; kind: Axis or HoodEncoder. Raises as find_family."""
    # drivers need cantools, which most commands do without
    if kind is HoodEncoder:
        from truearc.robot.hood_encoders import BY_DRIVER
        return BY_DRIVER[driver].table
    from truearc.hw.devices.registry import find_family
    return find_family(driver).axis


def struct_in(annotation: Any) -> Any:
    """The struct that a field's annotation is about, as in `tuple[Wheel, ...]`; None where there is none."""
    inner = (struct_in(part) for part in getattr(annotation, "__args__", ()))
    if isinstance(annotation, type) and issubclass(annotation, Struct):
        return annotation
    return next(filter(None, inner), None)


def _at(table: Any, key: str) -> Any:
    """What stands in nested tables at a dotted key; None where nothing does."""
    for name in re.findall(r"[^.\[\]]+", key):
        try:
            table = table[int(name) if isinstance(table, list | tuple) else name]
        except (LookupError, TypeError, ValueError):
            return None
    return table


def _known(key: str) -> list[str]:
    """The values of a key that takes few."""
    if key == "hood_encoder.driver":
        from truearc.robot.hood_encoders import BY_DRIVER
        return list(BY_DRIVER)
    if key.endswith(".driver") or key == "hood_encoder.controller":
        from truearc.hw.devices.registry import drivers
        return list(drivers())
    few = {"aim.policy": ["plan", "belief"]}
    return ["1", "-1"] if key.endswith(".direction") else few.get(key, [])


def line_of(text: str, message: str) -> str:
    """':line' of the key that the message quotes, in the table that it quotes, else of that table; '' if neither is."""
    *names, place = [re.sub(r"\[.*?\]", "", quoted.removeprefix("$").removeprefix("."))
                     for quoted in re.findall(r"`([^`]+)`", message)] or [""]
    table, _, key = place.rpartition(".")
    places = {(place, name) for name in names} | {(table, key)}
    header, begins = "", ""
    for number, line in enumerate(text.splitlines(), 1):
        if found := re.match(r"\s*\[+\s*([\w.]+)\s*\]", line):
            header = found[1]
            begins = begins or (f":{number}" if header == place else "")
        elif (found := re.match(r"\s*([\w-]+)\s*=", line)) and (header, found[1]) in places:
            return f":{number}"
    return begins


def line_of_key(text: str, key: str) -> str:
    """':line' of a dotted key, else of its table; '' where several tables have that name, or none has."""
    table = key.rpartition(".")[0]
    return line_of(text, f"`{key}`") if len(re.findall(rf"(?m)^\s*\[+\s*{re.escape(table)}\s*\]", text)) <= 1 else ""
