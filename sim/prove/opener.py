"""The grader's part: open the seals of what has been claimed, find out whatever was changed, and mark the rest."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import msgspec
from msgspec import Struct

from robot.config import BadInput
from sim.fanout import fan_out
from sim.prove.ledger import append, digest
from sim.prove.making import HOME
from sim.prove.marking import Mark, mark
from sim.prove.measure import measure
from sim.prove.mix import drawn_of
from sim.prove.room import ANSWERED, ASKED, CLAIMED, CLAIMED_AGAIN, GRADED, OPENED, SEALED, Room
from sim.prove.seal import canonical, check_data, hash_files, load_seal
from sim.prove.worldfile import append_line, lines_of, mend
from sim.shots import load_dataset

Progress = Callable[[float, str], None]
AT_ONCE = 8


class Graded(Struct, frozen=True):
    """Marks of one world: of what was said at first, and, where more shots were asked for and given, then."""

    world: str
    first: Mark
    again: Mark | None = None


def grade_round(room: Room, progress: Progress, workers: int | None = None,
                scheduler: str | None = None) -> tuple[Graded, ...]:
    """Marks of every claimed world, each opened and marked once. BadInput names all that was tampered with."""
    steps = room.steps()
    claimed = [name for name, done in steps.items() if CLAIMED in done and name != HOME
               and (ANSWERED not in done or CLAIMED_AGAIN in done)]
    wrong = [line for name in [*claimed, *([HOME] if HOME in steps else [])]
             for line in check_world(room, name, steps[name])]
    if wrong:
        raise BadInput("\n".join(wrong))
    mend(room.grades)
    known = {line["world"] for line in lines_of(room.grades)}
    todo = [name for name in claimed if name not in known]
    for name in todo:
        if OPENED not in steps[name]:
            append(room.ledger, OPENED, name, digest(room.seal(name).read_bytes()))
    for first in range(0, len(todo), AT_ONCE):
        batch = todo[first:first + AT_ONCE]
        progress(first / len(todo), "worlds are opened and marked")
        for one in fan_out(partial(mark_world, room.root.resolve()), batch, scheduler, workers=workers):
            append_line(room.grades, one)
    graded = graded_of(room)
    for one in graded:
        if GRADED not in steps[one.world]:
            append(room.ledger, GRADED, one.world, digest(canonical(msgspec.to_builtins(one))))
    progress(1.0, f"{len(graded)} worlds marked")
    return graded


def check_world(room: Room, world: str, done: dict[str, str]) -> list[str]:
    """What was changed after it was committed to, a sentence each: seal, data, claims, what was asked and answered."""
    seal = load_seal(room.seal(world))
    wrong = [] if seal.commitment == done.get(SEALED) else [f"{room.seal(world)}: is not what was sealed"]
    wrong += check_data(seal, room.data(world))
    given = {f"more/{name}": value for name, value in hash_files(room.more(world)).items()} if ANSWERED in done else {}
    if CLAIMED in done:
        wrong += _check_claims(room.claims(world), done[CLAIMED], seal.data)
    if ASKED in done and not wrong:
        asked = msgspec.json.decode(room.claims(world).read_bytes())["asked"]
        wrong += [] if digest(canonical(asked)) == done[ASKED] else [f"{room.claims(world)}: asked for something else"]
    if ANSWERED in done and digest(canonical(hash_files(room.more(world)))) != done[ANSWERED]:
        wrong.append(f"{room.more(world)}: is not what was given")
    if CLAIMED_AGAIN in done:
        wrong += _check_claims(room.again(world), done[CLAIMED_AGAIN], {**seal.data, **given})
    return wrong


def _check_claims(path: Path, claimed: str, data: dict[str, str]) -> list[str]:
    text = path.read_bytes() if path.is_file() else b""
    if digest(text) != claimed:
        return [f"{path}: is not what was claimed" if text else f"{path}: is missing"]
    return [] if msgspec.json.decode(text)["data"] == data else [f"{path}: claims are about other data than were given"]


def mark_world(root: Path, world: str) -> Graded:
    """One world's marks; BadInput where its seal is of no world that this grader can mark."""
    room = Room(root)
    drawn = drawn_of(load_seal(room.seal(world)).world, room.seal(world))
    measured = measure(drawn, load_dataset(room.data(world)))
    claims = [msgspec.json.decode(path.read_bytes()) for path in (room.claims(world), room.again(world))
              if path.is_file()]
    first, *again = (mark(drawn, one["finding"], measured, one.get("rivals")) for one in claims)
    return Graded(world, first, again[0] if again else None)


def graded_of(room: Room) -> tuple[Graded, ...]:
    """All marks of a round, a world each, in its order."""
    return tuple({line["world"]: msgspec.convert(line, Graded) for line in lines_of(room.grades)}.values())
