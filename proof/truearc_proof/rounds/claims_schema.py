"""Claims about sealed worlds: the fields of `truearc.finding/1` that a grader reads (docs/challenge.md)."""

from pathlib import Path
from typing import Any

import msgspec
from msgspec import Struct

from truearc.robot.config.schema import InputError


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


class Believed(Struct):
    """Tables of truearc.sim.infer.belief: what shots are foretold by without what was found, and with it."""

    before: dict[str, Any]
    after: dict[str, Any]


class Claims(Struct):
    """`data`: {file: SHA-256}; `asked`: further shots, or a measurement; `rivals`: what others say; `believed`: what is
    put to the sealed test. Whatever else is there is left."""

    data: dict[str, str]
    finding: dict[str, Any]
    asked: list[Any] = []
    rivals: dict[str, Any] = {}
    believed: Believed | None = None


def load_claims(path: Path) -> Claims:
    """InputError names the file, and the key that is missing or of another kind than it must be."""
    try:
        claims = msgspec.json.decode(path.read_bytes(), type=Claims)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from error
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: {error}") from error
    try:
        msgspec.convert(claims.finding, Finding)
    except msgspec.ValidationError as error:
        raise InputError(f"{path}: finding: {error}") from error
    return claims
