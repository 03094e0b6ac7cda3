"""The grader's part: open the seals of what has been claimed, find out whatever was changed, and mark the rest."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from robot.config import BadInput
from sim.fanout import fan_out
from sim.prove.ledger import append, digest
from sim.prove.making import HOME
from sim.prove.marking import Mark, mark
from sim.prove.measure import measure
from sim.prove.mix import Drawn
from sim.prove.room import CLAIMED, GRADED, OPENED, SEALED, Room
from sim.prove.seal import canonical, check_data, load_seal
from sim.prove.worldfile import append_line, lines_of, mend
from sim.shots import load_dataset

Progress = Callable[[float, str], None]
AT_ONCE = 8


def grade_round(room: Room, progress: Progress, workers: int | None = None,
                scheduler: str | None = None) -> tuple[Mark, ...]:
    """Marks of every claimed world, each opened and marked once. BadInput names all that was tampered with."""
    steps = room.steps()
    claimed = [name for name, done in steps.items() if CLAIMED in done and name != HOME]
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
        progress((len(claimed) - len(todo) + first) / len(claimed), "worlds are opened and marked")
        for one in fan_out(partial(mark_world, room.root.resolve()), batch, scheduler, workers=workers):
            append_line(room.grades, one)
    marks = marks_of(room)
    for one in marks:
        if GRADED not in steps[one.world]:
            append(room.ledger, GRADED, one.world, digest(canonical(msgspec.to_builtins(one))))
    progress(1.0, f"{len(marks)} worlds marked")
    return marks


def check_world(room: Room, world: str, done: dict[str, str]) -> list[str]:
    """What was changed after it was committed to, a sentence each: seal, data, claims."""
    seal = load_seal(room.seal(world))
    wrong = [] if seal.commitment == done.get(SEALED) else [f"{room.seal(world)}: is not what was sealed"]
    wrong += check_data(seal, room.data(world))
    if CLAIMED in done:
        path = room.claims(world)
        data = path.read_bytes() if path.is_file() else b""
        if digest(data) != done[CLAIMED]:
            wrong.append(f"{path}: is not what was claimed" if data else f"{path}: is missing")
        elif msgspec.json.decode(data)["data"] != seal.data:
            wrong.append(f"{path}: claims are about other data than were sealed")
    return wrong


def mark_world(root: Path, world: str) -> Mark:
    """One world's marks; BadInput where its seal is of no world that this grader knows."""
    room = Room(root)
    drawn = drawn_of(load_seal(room.seal(world)).world, room.seal(world))
    claims: dict[str, Any] = msgspec.json.decode(room.claims(world).read_bytes())
    return mark(drawn, claims["finding"], measure(drawn, load_dataset(room.data(world))))


def drawn_of(world: dict[str, Any], path: Path) -> Drawn:
    try:
        return msgspec.convert(world, Drawn)
    except msgspec.ValidationError as error:
        raise BadInput(f"{path}: world: {error}: it cannot be marked by this grader, only verified") from error


def marks_of(room: Room) -> tuple[Mark, ...]:
    """All marks of a round, a world each, in its order."""
    return tuple({line["world"]: msgspec.convert(line, Mark) for line in lines_of(room.grades)}.values())
