"""Sealed rounds on disk: their layout, ledger, lock and committed documents (seals and claims).

    ROUND/lock                    held by the writing process
    ROUND/half/                   unfinished data, which is never read
    ROUND/ledger.jsonl            every step of every world, as a hash chain
    ROUND/data/w0001/             a released dataset; of a foreign world, its practice is in the folder home
    ROUND/data/home/              MuJoCo's robot before any change, if there are such worlds
    ROUND/claims/w0001.json       the solver's claims about that dataset
    ROUND/keeper/round.json       how the round was drawn; not for the solver
    ROUND/keeper/w0001.json       the world's seal; not for the solver
    ROUND/grades.jsonl            marks of opened worlds
    ROUND/figures.json            the figures of the printed tables, with intervals

The ledger has one JSON object per line, each with the SHA-256 of the preceding line, so that no line can be changed,
removed or inserted without breaking the chain. Lines are only appended, and are on disk before their subject is
released.

    {"number": 3, "what": "sealed", "world": "w0001", "sha256": "...", "before": "..."}

The kernel releases the lock when its holder dies. Each role of a round holds the lock while it writes. A solver whose
parent was killed thus still holds it, and a process that resumes the round gets an error instead of writing at the same
time.

A seal contains the truth of a world and the hashes of its data, and is committed to before the data are released. The
commitment is the SHA-256 of the seal's canonical JSON (sorted keys, no spaces, floats as the shortest text that reads
back exactly). A salt of 32 random bytes prevents a search for worlds that match.

Claims have the format `truearc.claims/2`, which defines the keys that a grader reads (docs/how-to/challenge.md). All
values that are compared are ids: verdicts, names of terms, parameters, columns, stages, directions and instruments.
Sentences are for human readers only.
"""

import hashlib
import json
import os
import secrets
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any, Literal

import msgspec
from msgspec import Struct

from truearc.errors import InputError, about, load_bytes, naming
from truearc.robot.recording.files import claim

FIRST = "0" * 64                      # before the first line there is nothing
LOCK = "lock"                         # stays there, empty, when no process holds it


class Step(StrEnum):
    """What is entered about a world, in this order."""

    SEALED = "sealed"
    CLAIMED = "claimed"
    OPENED = "opened"
    GRADED = "graded"


# older rounds, in which solvers requested further shots, have steps between claims and opening, which count no more
STEPS = (Step.SEALED, Step.CLAIMED, "asked", "answered", "claimed again", Step.OPENED, Step.GRADED)


class Entry(Struct, frozen=True, forbid_unknown_fields=True):
    """`sha256`: of what was committed to at this step of this world."""

    number: int
    what: str
    world: str
    sha256: str
    before: str


def digest(data: bytes) -> str:
    """Return the SHA-256 in hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def read_ledger(path: str | Path) -> tuple[Entry, ...]:
    """Return every line; InputError names the first that does not follow from the one before it.

    A truncated last line is ignored: its data were not released yet.
    """
    path = Path(path)
    lines = path.read_bytes().split(b"\n") if path.is_file() else [b""]
    entries: list[Entry] = []
    before = FIRST
    for number, line in enumerate(lines[:-1], 1):
        with naming(f"{path}: line {number}"):
            entry = msgspec.json.decode(line, type=Entry)
        if entry.number != number or entry.before != before:
            raise InputError(f"{path}: line {number}: does not follow from the line before it: the ledger was changed")
        if entry.what not in STEPS:
            raise InputError(f"{path}: line {number}: there is no step {entry.what!r}")
        entries.append(entry)
        before = digest(line)
    return tuple(entries)


def last_digest(path: str | Path) -> str:
    """Return the SHA-256 of the last whole line, which depends on all before it; FIRST if there is none."""
    lines = Path(path).read_bytes().split(b"\n")[:-1] if Path(path).is_file() else []
    return digest(lines[-1]) if lines else FIRST


def append(path: str | Path, what: str, world: str, sha256: str) -> Entry:
    """Add a line and wait until it is on the disk; for one writer. InputError if the ledger is already broken."""
    path = Path(path)
    entries = read_ledger(path)
    data = path.read_bytes() if path.is_file() else b""
    whole = data[:data.rfind(b"\n") + 1]
    entry = Entry(len(entries) + 1, what, world, sha256, last_digest(path))
    with path.open("r+b" if path.is_file() else "wb") as file:
        file.truncate(len(whole))     # what a kill has torn
        file.seek(len(whole))
        file.write(msgspec.json.encode(entry) + b"\n")
        file.flush()
        os.fsync(file.fileno())
    return entry


def committed(entries: tuple[Entry, ...], world: str) -> dict[str, str]:
    """Return {step: SHA-256} of one world; InputError for steps that occur twice or in another order than STEPS."""
    found: dict[str, str] = {}
    for entry in entries:
        if entry.world != world:
            continue
        late = [step for step in found if STEPS.index(step) >= STEPS.index(entry.what)]
        if late:
            raise InputError(f"ledger: line {entry.number}: {world} is {entry.what!r} after it was {late[-1]!r}")
        found[entry.what] = entry.sha256
    return found


PLACES = {"ledger": "ledger.jsonl", "keeper": "keeper", "plan": "keeper/round.json", "grades": "grades.jsonl",
          "figures": "figures.json", "half": "half"}


@dataclass(frozen=True)
class Room:
    """Locations in a round: those of PLACES, and each world's."""

    root: Path

    def __getattr__(self, name: str) -> Path:
        if name not in PLACES:
            raise AttributeError(name)
        return self.root / PLACES[name]

    def data(self, world: str) -> Path:
        return self.root / "data" / world

    def seal(self, world: str) -> Path:
        return self.keeper / f"{world}.json"

    def claims(self, world: str) -> Path:
        return self.root / "claims" / f"{world}.json"

    def steps(self) -> dict[str, dict[str, str]]:
        """Return {world: {step: SHA-256}} of every world in the ledger, in its order; InputError if it was changed."""
        entries = read_ledger(self.ledger)
        return {world: committed(entries, world) for world in dict.fromkeys(entry.world for entry in entries)}


@contextmanager
def alone(root: Path) -> Iterator[None]:
    """Hold the lock as the only writer; InputError if another process is one. A missing directory is created."""
    root.mkdir(parents=True, exist_ok=True)
    with (root / LOCK).open("ab") as file:           # no child inherits it
        try:
            claim(file)
        except OSError as error:
            raise InputError(f"{root}: this round is being played by another process; go on when that has ended"
                           ) from error
        yield


# --- seals and claims

SALT_BYTES = 32
SCHEMA = "truearc.claims/2"


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
    """Return the unique JSON text of plain values; ValueError for numbers that are not finite, which JSON lacks."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False).encode()


def make_seal(world: Mapping[str, Any], maker: str, directory: str | Path, salt: bytes | None = None) -> Seal:
    """Seal a world with the data in `directory`; a salt is drawn if none is given."""
    salt = secrets.token_bytes(SALT_BYTES) if salt is None else salt
    return Seal(dict(world), maker, hash_files(directory), salt.hex())


def hash_files(directory: str | Path) -> dict[str, str]:
    """Return {path with forward slashes: SHA-256} of every file below, sorted."""
    root = Path(directory)
    return {path.relative_to(root).as_posix(): digest(path.read_bytes())
            for path in sorted(root.rglob("*")) if path.is_file()}


def save_seal(path: str | Path, seal: Seal) -> None:
    Path(path).write_bytes(msgspec.json.format(canonical(msgspec.to_builtins(seal)), indent=1) + b"\n")


def load_seal(path: str | Path) -> Seal:
    """Load a seal; InputError names the file and what is wrong with it."""
    with naming(path):
        seal = msgspec.json.decode(load_bytes(path), type=Seal)
    with about(f"{path}: world", ValueError):     # a number in it that is not finite
        canonical(seal.world)
    return seal


def check_data(seal: Seal, directory: str | Path) -> list[str]:
    """Return a sentence for each released file that differs from the sealed data."""
    there = hash_files(directory)
    changed = [name for name in seal.data if name in there and there[name] != seal.data[name]]
    return ([f"{Path(directory) / name}: was changed" for name in changed]
            + [f"{Path(directory) / name}: is missing" for name in seal.data if name not in there]
            + [f"{Path(directory) / name}: was not among the sealed data" for name in there if name not in seal.data])


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

    data: {file: SHA-256}. rivals: {name: its claim}. believed: the two beliefs of the sealed test.
    """

    data: dict[str, str]
    finding: dict[str, Any]
    schema: Literal["truearc.claims/2"] = "truearc.claims/2"
    rivals: dict[str, Any] = {}
    believed: Believed | None = None


def load_claims(path: Path) -> Claims:
    """Load claims.

    Raises:
        InputError: with the file, and the key that is missing or of another kind than it must be.
    """
    with naming(path):
        claims = msgspec.json.decode(load_bytes(path), type=Claims)
    with naming(f"{path}: finding"):
        msgspec.convert(claims.finding, Finding)
    return claims
