"""The log of a round of concealed worlds: what was committed to, and in which order.

One JSON object a line, each with the SHA-256 of the line before it, so that no line can be changed, left out or put in
without breaking the chain; lines are only ever added at the end, and are on the disk before whatever they are about is
given away.

    {"number": 3, "what": "sealed", "world": "w0001", "sha256": "...", "before": "..."}
"""

import hashlib
import os
from pathlib import Path

import msgspec
from msgspec import Struct

from truearc.errors import InputError

FIRST = "0" * 64                      # before the first line there is nothing
# In the order in which they come for one world; the last three only where the solver asks for more.
STEPS = ("sealed", "claimed", "asked", "answered", "claimed again", "opened", "graded")


class Entry(Struct, frozen=True, forbid_unknown_fields=True):
    """`sha256`: of what was committed to at this step of this world."""

    number: int
    what: str
    world: str
    sha256: str
    before: str


def digest(data: bytes) -> str:
    """SHA-256 in hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def read_ledger(path: str | Path) -> tuple[Entry, ...]:
    """Every line; InputError names the first that does not follow from the one before it.

    A last line that a kill has torn is ignored: its data were not given away yet.
    """
    path = Path(path)
    lines = path.read_bytes().split(b"\n") if path.is_file() else [b""]
    entries: list[Entry] = []
    before = FIRST
    for number, line in enumerate(lines[:-1], 1):
        try:
            entry = msgspec.json.decode(line, type=Entry)
        except msgspec.MsgspecError as error:
            raise InputError(f"{path}: line {number}: {error}") from error
        if entry.number != number or entry.before != before:
            raise InputError(f"{path}: line {number}: does not follow from the line before it: the ledger was changed")
        if entry.what not in STEPS:
            raise InputError(f"{path}: line {number}: there is no step {entry.what!r}")
        entries.append(entry)
        before = digest(line)
    return tuple(entries)


def last_digest(path: str | Path) -> str:
    """SHA-256 of the last whole line, in which all before it is contained; FIRST where there is none."""
    lines = Path(path).read_bytes().split(b"\n")[:-1] if Path(path).is_file() else []
    return digest(lines[-1]) if lines else FIRST


def append(path: str | Path, what: str, world: str, sha256: str) -> Entry:
    """Add a line and wait until it is on the disk; for one writer. InputError where the ledger is broken already."""
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
    """{step: SHA-256} of one world; InputError for steps that come twice or in another order than STEPS."""
    found: dict[str, str] = {}
    for entry in entries:
        if entry.world != world:
            continue
        late = [step for step in found if STEPS.index(step) >= STEPS.index(entry.what)]
        if late:
            raise InputError(f"ledger: line {entry.number}: {world} is {entry.what!r} after it was {late[-1]!r}")
        found[entry.what] = entry.sha256
    return found
