"""A small round as its tests play it, and what a cheat does to it: kinder marks, other claims, a chain made anew."""

import contextlib
import io
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any
from unittest.mock import patch

import msgspec

from truearc.cli.main import main
from truearc_proof.rounds import Entry, Room, append, read_ledger, solver

ARGUMENTS = ["--worlds", "3", "--level", "L0", "--shots", "40", "--engines", "numpy", "--seed", "3", "--processes", "1"]


def quiet(done: float, note: str) -> None:
    pass


def prove_apart(root: Path, *more: str) -> subprocess.CompletedProcess[str]:
    """Run `truearc prove` in a process of its own."""
    return subprocess.run([sys.executable, "-m", "truearc", "prove", *more, "--out", str(root)], capture_output=True,
                          text=True, check=False)


def prove(root: Path, *more: str) -> subprocess.CompletedProcess[str]:
    """Run `truearc prove` in this process, which has imported and compiled most of what it needs. Here the solver does
    not refuse the seals, as it would to the end of the process; a round of all roles has it in one of its own."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), patch.object(solver, "forbid"):
        code = main(["prove", *more, "--out", str(root)])
    return subprocess.CompletedProcess([*more], code, out.getvalue(), err.getvalue())


def chain_anew(room: Room, entries: Iterable[Entry]) -> None:
    """A ledger of these entries, whole and consistent."""
    entries = list(entries)
    room.ledger.unlink(missing_ok=True)
    for one in entries:
        append(room.ledger, one.what, one.world, one.sha256)


def enter_otherwise(room: Room, world: str, new: dict[str, str]) -> None:
    """The ledger with other hashes {step: SHA-256} of that world, the chain made anew."""
    chain_anew(room, [msgspec.structs.replace(one, sha256=new[one.what]) if one.world == world and one.what in new
                      else one for one in read_ledger(room.ledger)])


def leave_world_out(room: Room, world: str, step: str | None = None) -> None:
    """The ledger without that step of it, or without all of it."""
    chain_anew(room, [one for one in read_ledger(room.ledger) if one.world != world or step not in (None, one.what)])


def make_mark_kinder(room: Room, number: int) -> dict[str, Any]:
    """Another verdict in that line of the marks; the line."""
    lines = [msgspec.json.decode(line) for line in room.grades.read_bytes().splitlines()]
    lines[number]["first"]["verdict"] = "named, of course"
    room.grades.write_bytes(b"".join(msgspec.json.encode(line) + b"\n" for line in lines))
    return dict(lines[number])
