"""A sealed world: what is true of it, and the hashes of its data, committed to before anybody has seen them.

The commitment is the SHA-256 of the seal's canonical JSON (keys sorted, no spaces, floats as the shortest text that
reads back exactly). A salt of 32 random bytes keeps anybody from guessing worlds until one fits.
"""

import json
import math
import secrets
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
from msgspec import Struct

from truearc.errors import InputError
from truearc_proof.rounds.ledger import digest

SALT_BYTES = 32


class Seal(Struct, frozen=True, forbid_unknown_fields=True):
    """`world`: all that is true, plain values; `maker`: engine and version that made the data; `data`: {file's path in
    the released directory: SHA-256}."""

    world: dict[str, Any]
    maker: str
    data: dict[str, str]
    salt: str

    @property
    def commitment(self) -> str:
        return digest(canonical(msgspec.to_builtins(self)))


def canonical(value: Any) -> bytes:
    """The one JSON text of plain values; ValueError for numbers that are not finite, which JSON does not have."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False).encode()


def make_seal(world: Mapping[str, Any], maker: str, directory: str | Path, salt: bytes | None = None) -> Seal:
    """Seal a world with the data that lie in `directory`; a salt is drawn when none is given."""
    salt = secrets.token_bytes(SALT_BYTES) if salt is None else salt
    return Seal(dict(world), maker, hash_files(directory), salt.hex())


def hash_files(directory: str | Path) -> dict[str, str]:
    """{path with forward slashes: SHA-256} of every file below, sorted."""
    root = Path(directory)
    return {path.relative_to(root).as_posix(): digest(path.read_bytes())
            for path in sorted(root.rglob("*")) if path.is_file()}


def save_seal(path: str | Path, seal: Seal) -> None:
    Path(path).write_bytes(msgspec.json.format(canonical(msgspec.to_builtins(seal)), indent=1) + b"\n")


def load_seal(path: str | Path) -> Seal:
    """InputError names the file and what is wrong with it."""
    try:
        seal = msgspec.json.decode(Path(path).read_bytes(), type=Seal)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}") from error
    except msgspec.MsgspecError as error:
        raise InputError(f"{path}: {error}") from error
    if not _is_plain(seal.world):
        raise InputError(f"{path}: world: a number in it is not finite")
    return seal


def check_data(seal: Seal, directory: str | Path) -> list[str]:
    """Return a sentence for each released file that differs from the sealed data."""
    there = hash_files(directory)
    changed = [name for name in seal.data if name in there and there[name] != seal.data[name]]
    return ([f"{Path(directory) / name}: was changed" for name in changed]
            + [f"{Path(directory) / name}: is missing" for name in seal.data if name not in there]
            + [f"{Path(directory) / name}: was not among the sealed data" for name in there if name not in seal.data])


def _is_plain(value: Any) -> bool:
    if isinstance(value, dict):
        return all(map(_is_plain, value.values()))
    if isinstance(value, list):
        return all(map(_is_plain, value))
    return not isinstance(value, float) or math.isfinite(value)
