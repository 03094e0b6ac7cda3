"""Hash of a configuration, by which a recording names what it ran with."""

import hashlib
from typing import Any

import msgspec
from msgspec import UNSET, Struct

from truearc.robot.config.schema import Config


def config_hash(config: Config) -> str:
    """SHA-256 of what the configuration says, however its file was written or the value came here.

    A key that may be left out and has its default counts as left out, so that a later version may add keys.
    """
    return _sha256(_stated(config))


def is_hash_of(sha256: str, config: Config) -> bool:
    """Whether a recording's hash is this configuration's.

    Recordings made until November 2026 hash the encoded text, in which a default was left out only if it was the very
    same object; read back from its own file, a configuration still encodes as it did then.
    """
    return sha256 in (config_hash(config), _sha256(config))


def _sha256(content: object) -> str:
    return hashlib.sha256(msgspec.json.encode(content, order="deterministic")).hexdigest()


def _stated(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_stated(part) for part in value]
    if not isinstance(value, Struct):
        return value
    settings = value.__struct_config__
    tag = {settings.tag_field: settings.tag} if settings.tag_field else {}
    fields = ((field, getattr(value, field.name)) for field in msgspec.structs.fields(value))
    return tag | {field.encode_name: _stated(said) for field, said in fields
                  if said is not UNSET and not (settings.omit_defaults and said == field.default)}
