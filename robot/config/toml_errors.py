"""Errors in a TOML file: msgspec's messages reworded, and the line of the key that they name."""

import re

_INNER_PLACE = re.compile(r" - at `\$([^`]*)` - at `\$([^`]*)`$")      # of an axis's key, and of the axis


def joined(message: str) -> str:
    """A message with the place of an axis's key behind that of its axis."""
    return _INNER_PLACE.sub(r" - at `$\2\1`", message)


def reworded(message: str) -> str:
    """msgspec's message in the words of our messages."""
    if message.startswith("Invalid value") and message.endswith(".driver`"):
        from truearc.hw.devices.registry import drivers
        message += f" (there are {', '.join(drivers())})"
    return (message.replace("Object contains unknown field", "unknown key")
            .replace("Object missing required field", "missing key").replace("`$.", "`").replace(" - at `$`", ""))


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
