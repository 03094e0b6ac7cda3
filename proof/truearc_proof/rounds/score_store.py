"""Marks on disk against the ledger: what a table is made of is what was entered when the worlds were marked."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from truearc.errors import InputError
from truearc_proof.rounds.commitment import canonical
from truearc_proof.rounds.jsonl_store import append_line, lines_of
from truearc_proof.rounds.ledger import append, digest
from truearc_proof.rounds.round_layout import GRADED, Room

Steps = Mapping[str, Mapping[str, str]]


def hash_mark(line: Any) -> str:
    """Of a world's marks as their line of the file has them."""
    return digest(canonical(msgspec.json.decode(msgspec.json.encode(line))))


def save_mark(room: Room, world: str, line: Any, done: Mapping[str, str]) -> None:
    """Enter a world's marks into the ledger, then append them to the file, so that each line there has an entry.

    Marks that a kill in between has lost are made again; InputError where they come out otherwise.
    """
    if GRADED not in done:
        append(room.ledger, GRADED, world, hash_mark(line))
    elif done[GRADED] != hash_mark(line):
        raise InputError(f"{room.grades}: {world}: its line is missing, and it is marked otherwise than it was")
    append_line(room.grades, line)


def load_marks(room: Room) -> list[dict[str, Any]]:
    """All lines; InputError where one is not as the ledger has it, or is missing."""
    steps = room.steps()
    wrong = [*wrong_marks(room.grades, steps), *missing_marks(room.grades, steps)]
    if wrong:
        raise InputError("\n".join(wrong))
    return list(lines_of(room.grades))


def wrong_marks(path: Path, steps: Steps) -> list[str]:
    """Lines that the ledger does not have, or has otherwise; a sentence each."""
    wrong = []
    for line in lines_of(path):
        world = str(line.get("world")) if isinstance(line, dict) else None
        entered = steps.get(world, {}).get(GRADED) if world else None
        if entered is None:
            wrong.append(f"{path}: {world}: is marked here, but not in the ledger: take the line out")
        elif hash_mark(line) != entered:
            wrong.append(f"{path}: {world} is not marked as the ledger has it")
    return wrong


def missing_marks(path: Path, steps: Steps) -> list[str]:
    """Worlds that are marked in the ledger alone; a sentence each."""
    there = worlds_of(path)
    return [f"{path}: {world} is not marked as the ledger has it: its line is missing" for world, done in steps.items()
            if GRADED in done and world not in there]


def worlds_of(path: Path) -> set[str]:
    return {str(line["world"]) for line in lines_of(path) if isinstance(line, dict) and "world" in line}
