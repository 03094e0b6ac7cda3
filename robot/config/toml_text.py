"""TOML from plain values; reading it is the standard library's."""

import json
from typing import Any


def make_toml(table: dict[str, Any], prefix: str = "") -> str:
    """TOML text of nested tables, lists of tables and plain values; None is left out."""
    plain = {key: value for key, value in table.items() if not isinstance(value, dict) and not _is_tables(value)}
    text = "".join(f"{_key(key)} = {_value(value)}\n" for key, value in plain.items() if value is not None)
    for key, value in table.items():
        name = prefix + _key(key)
        if isinstance(value, dict):
            text += f"\n[{name}]\n" + make_toml(value, name + ".")
        elif _is_tables(value):
            text += "".join(f"\n[[{name}]]\n" + make_toml(row, name + ".") for row in value)
    return text


def _is_tables(value: Any) -> bool:
    return isinstance(value, list | tuple) and len(value) > 0 and all(isinstance(row, dict) for row in value)


def _key(key: str) -> str:
    bare = key.replace("_", "").replace("-", "")
    return key if bare.isascii() and bare.isalnum() else _value(key)


def _value(value: Any) -> str:
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(part) for part in value) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        # a JSON string is a TOML basic string except for DEL, which TOML wants escaped
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(value)
