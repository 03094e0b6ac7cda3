"""What somebody says of a sealed world, as far as whoever marks it must be able to read it (docs/formats.md)."""

from pathlib import Path
from typing import Any

import msgspec
from msgspec import Struct

from robot.config import BadInput


class Mismatch(Struct):
    found: bool
    p_value: float | None = None


class Term(Struct):
    term: str
    probability: float | None = None
    parameters: dict[str, Any] | None = None


class Finding(Struct):
    mismatch: Mismatch
    verdict: str
    what: list[Term] | None = None


class Claims(Struct):
    """`data`: {file: SHA-256}; `asked`: further shots; `rivals`: what others say. Whatever else is there is left."""

    data: dict[str, str]
    finding: dict[str, Any]
    asked: list[Any] = []
    rivals: dict[str, Any] = {}


def load_claims(path: Path) -> Claims:
    """BadInput names the file, and the key that is missing or of another kind than it must be."""
    try:
        claims = msgspec.json.decode(path.read_bytes(), type=Claims)
    except OSError as error:
        raise BadInput(f"{path}: {error.strerror or error}") from error
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise BadInput(f"{path}: {error}") from error
    try:
        msgspec.convert(claims.finding, Finding)
    except msgspec.ValidationError as error:
        raise BadInput(f"{path}: finding: {error}") from error
    return claims
