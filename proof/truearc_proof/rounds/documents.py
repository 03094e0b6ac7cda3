"""Documents of a round: the seal of a world and the claims about it.

A seal is what is true of a world, and the hashes of its data, committed to before anybody has seen them. The commitment
is the SHA-256 of the seal's canonical JSON (keys sorted, no spaces, floats as the shortest text that reads back
exactly). A salt of 32 random bytes keeps anybody from guessing worlds until one fits.

Claims are `truearc.claims/2`: the keys that a grader reads (docs/how-to/challenge.md). Everything that is compared is
an id: verdicts, names of terms, parameters, columns, stages, directions, instruments. Sentences are for people.
`truearc.claims/1`, which the published rounds have, named instruments by their text.
"""

import json
import math
import secrets
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import msgspec
from msgspec import Struct, field

from truearc.errors import InputError
from truearc_proof.rounds.ledger import digest

SALT_BYTES = 32
SCHEMA, SCHEMA_1 = "truearc.claims/2", "truearc.claims/1"
# {text of schema 1: id of the instrument}, as truearc wrote them at tag proof-1.
INSTRUMENTS_1: Mapping[str, str] = {
    "target height with a tape": "target_height_tape",
    "exit height with a tape": "exit_height_tape",
    "distance with a tape at 3 stations": "distance_tape",
    "hood angle with an inclinometer": "inclinometer",
    "hood angle with an inclinometer, from both sides": "inclinometer_both_ways",
    "wheel diameter with calipers, wheel speed with an optical tachometer": "calipers_tachometer",
    "the wind with an anemometer": "anemometer",
    "the camera's delay, by a lamp in its view that the robot switches": "delay_lamp",
    "a ruler in the tracker's view": "ruler",
    "a plumb line in the tracker's view": "plumb_line",
    "a stopwatch in the tracker's view": "stopwatch",
}


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
    """Tables of truearc.sim.infer.belief that forecast shots without the finding, and with it."""

    before: dict[str, Any]
    after: dict[str, Any]


class Claims(Struct):
    """Claims about one world; further keys are ignored.

    data: {file: SHA-256}. written: requests for further shots, or for one measurement, as
    the file has them, by which the ledger knows them. rivals: {name: its claim}. believed: the two beliefs of the
    sealed test.
    """

    data: dict[str, str]
    finding: dict[str, Any]
    schema: Literal["truearc.claims/1", "truearc.claims/2"] = "truearc.claims/2"
    written: list[Any] = field(name="asked", default_factory=list)
    rivals: dict[str, Any] = {}
    believed: Believed | None = None

    @property
    def asked(self) -> list[Any]:
        """`written` with instruments by their ids, whatever the schema."""
        return self.written if self.schema == SCHEMA else list(map(_upgrade_request, self.written))


def load_claims(path: Path) -> Claims:
    """Read claims of either schema; keys are as in schema 2.

    Raises:
        InputError: with the file, and the key that is missing or of another kind than it must be.
    """
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


def _upgrade_request(one: Any) -> Any:
    """A request of schema 1 as schema 2 has it; what no instrument is called is left for the keeper to refuse."""
    if not isinstance(one, dict) or not isinstance(one.get("measure"), str):
        return one
    return {**one, "measure": INSTRUMENTS_1.get(one["measure"], one["measure"])}
