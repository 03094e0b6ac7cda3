"""A configuration as a recording keeps it: config.json, and the hash by which session.json names it."""

import hashlib
from typing import Any

import msgspec

from truearc.hw.plugins import PluginError
from truearc.robot.config.reading_tables import find_table, stated
from truearc.robot.config.schema import Config, read_axis


def config_hash(config: Config) -> str:
    """SHA-256 of what the configuration says, however its file was written or the value came here.

    A key that may be left out and has its default counts as left out, so that a later version may add keys.
    """
    table = stated(config)
    return _sha256(table | table.pop("readings"))


def is_hash_of(sha256: str, config: Config) -> bool:
    """Whether a recording's hash is this configuration's.

    Recordings made until November 2026 hash the encoded text, in which a default was left out only if it was the very
    same object; read back from its own file, a configuration still encodes as it did then.
    """
    return sha256 in (config_hash(config), hashlib.sha256(msgspec.json.encode(table_of(config))).hexdigest())


def table_of(config: Config) -> dict[str, Any]:
    """The configuration as config.json has it: tables of other distributions stand beside truearc's own."""
    table: dict[str, Any] = msgspec.to_builtins(config)
    others: dict[str, Any] = table.pop("readings", {})
    last = {key: table.pop(key) for key in ("recording",) if key in table}
    return table | others | last


def config_of(data: dict[str, Any]) -> Config:
    """The configuration of what config.json has; msgspec.ValidationError where it is none.

    A table that is not truearc's own is taken as it is, also where its distribution is not installed.
    """
    others = {name: part for name, part in data.items()
              if name not in Config.__struct_fields__ and isinstance(part, dict)}
    own = {name: part for name, part in data.items() if name not in others}
    return msgspec.convert(own | {"readings": {name: _without_defaults(name, part) for name, part in others.items()}},
                           Config, dec_hook=read_axis)


def _without_defaults(name: str, table: dict[str, Any]) -> dict[str, Any]:
    """The table as a hash takes it; as it is where nothing installed knows it."""
    try:
        plain: dict[str, Any] = stated(msgspec.convert(table, find_table(name).table))
        return plain
    except (LookupError, PluginError):
        return table


def _sha256(content: object) -> str:
    return hashlib.sha256(msgspec.json.encode(content, order="deterministic")).hexdigest()
