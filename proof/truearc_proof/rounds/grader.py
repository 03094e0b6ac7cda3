"""The grader of a round, which refuses changed files, opens the seals of claimed worlds, and marks the claims.

If any file of the round was changed, the grader refuses the whole round. Its tables use only the ledger entries made
when the worlds were marked.
"""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
from msgspec import Struct, structs

from truearc.errors import InputError
from truearc.sim.data.files import load_dataset
from truearc.sim.infer.belief import from_table
from truearc.sim.printed import Progress
from truearc_proof.parallel import append_line, fan_out, lines_of, mend
from truearc_proof.rounds import (
    Room,
    Step,
    alone,
    append,
    canonical,
    check_data,
    digest,
    load_claims,
    load_seal,
)
from truearc_proof.rounds.committer import load_plan
from truearc_proof.rounds.marks import Mark, mark, measure, off_m, shoot_unseen
from truearc_proof.rounds.worlds import HOME, OWN, Drawn, drawn_of

Steps = Mapping[str, Mapping[str, str]]


def hash_mark(line: Any) -> str:
    """Return the hash of a world's marks as written in the file."""
    return digest(canonical(msgspec.json.decode(msgspec.json.encode(line))))


def save_mark(room: Room, world: str, line: Any, done: Mapping[str, str]) -> None:
    """Enter a world's marks into the ledger, then append them to the file, so that each line there has an entry.

    Marks lost because a kill came in between are made again; InputError if they differ.
    """
    if Step.GRADED not in done:
        append(room.ledger, Step.GRADED, world, hash_mark(line))
    elif done[Step.GRADED] != hash_mark(line):
        raise InputError(f"{room.grades}: {world}: its line is missing, and it is marked otherwise than it was")
    append_line(room.grades, line)


def wrong_marks(path: Path, steps: Steps) -> list[str]:
    """Return a sentence for each line that the ledger lacks or has differently."""
    wrong = []
    for line in lines_of(path):
        world = str(line.get("world")) if isinstance(line, dict) else None
        entered = steps.get(world, {}).get(Step.GRADED) if world else None
        if entered is None:
            wrong.append(f"{path}: {world}: is marked here, but not in the ledger: take the line out")
        elif hash_mark(line) != entered:
            wrong.append(f"{path}: {world} is not marked as the ledger has it")
    return wrong


def missing_marks(path: Path, steps: Steps) -> list[str]:
    """Return a sentence for each world that is marked only in the ledger."""
    there = worlds_of(path)
    return [f"{path}: {world} is not marked as the ledger has it: its line is missing" for world, done in steps.items()
            if Step.GRADED in done and world not in there]


def worlds_of(path: Path) -> set[str]:
    return {str(line["world"]) for line in lines_of(path) if isinstance(line, dict) and "world" in line}


class Graded(Struct, frozen=True):
    """Marks of one world; older rounds also have those of what was said after further shots, which are left out."""

    world: str
    first: Mark


def grade_round(room: Room, progress: Progress, workers: int | None = None, so_far: bool = False) -> tuple[Graded, ...]:
    """Return the marks of every world, each opened and marked once; InputError names tampered and unclaimed worlds.

    so_far: the round goes on: worlds that are not claimed are waited for.
    """
    with alone(room.root):
        mend(room.grades)
        steps = room.steps()
        wrong = check_papers(room, steps, so_far) + wrong_marks(room.grades, steps)
        if not so_far:
            wrong += [f"{room.claims(name)}: is missing: there is no claim about {name} (--so-far, where the "
                      "round goes on)" for name in unclaimed(steps)]
        if wrong:
            raise InputError("\n".join(wrong))
        _mark_claimed(room, steps, progress, workers)
    return graded_of(room)


def _mark_claimed(room: Room, steps: Steps, progress: Progress, workers: int | None) -> None:
    known = worlds_of(room.grades)
    todo = [name for name, done in steps.items() if Step.CLAIMED in done and name != HOME and name not in known]
    for name in todo:
        if Step.OPENED not in steps[name]:
            append(room.ledger, Step.OPENED, name, digest(room.seal(name).read_bytes()))
    jobs = [drawn_of(load_seal(room.seal(name)).world, room.seal(name)) for name in todo]
    fan_out(partial(mark_world, room.root.resolve()), jobs,
            lambda done, note: progress(done, "worlds are opened and marked"), workers,
            lambda job, one: save_mark(room, one.world, one, steps[one.world]))
    progress(1.0, f"{len(known) + len(todo)} worlds marked")


def unclaimed(steps: Steps) -> list[str]:
    """Return worlds that were sealed but not claimed."""
    return [name for name, done in steps.items() if Step.CLAIMED not in done and name != HOME]


def check_papers(room: Room, steps: Steps, so_far: bool) -> list[str]:
    """Return a sentence for each change or omission in the round. so_far: not all worlds need be sealed yet."""
    wrong = [f"{room.ledger}: {name}: was never sealed" for name, done in steps.items() if Step.SEALED not in done]
    wrong += [line for name, done in steps.items() if Step.SEALED in done for line in check_world(room, name, done)]
    wrong += [] if so_far else left_out(room, steps)
    return wrong or check_draw(room, steps, so_far)


def left_out(room: Room, steps: Steps) -> list[str]:
    """Return a sentence for each seal that the ledger lacks."""
    return [f"{path}: its world is not in the ledger: it was taken out, or `truearc prove seal` was cut short"
            for path in sorted(room.keeper.glob("*.json")) if path != room.plan and path.stem not in steps]


def check_draw(room: Room, steps: Steps, so_far: bool = False) -> list[str]:
    """Return a sentence for each world that the seed does not give, or that is missing; external worlds have no
    seed.

    so_far: not all need be sealed yet.
    """
    sealed = {name: load_seal(room.seal(name)).world for name in steps}
    ours = {name: world for name, world in sealed.items() if world.get("engine") != OWN}
    if not ours and not room.plan.exists():
        return []
    drawn = {one.name: msgspec.to_builtins(one) for one in load_plan(room).drawn()}
    return [f"{room.seal(name)}: is not what the seed of the round gives; or {room.plan} was changed"
            for name, world in ours.items() if canonical(world) != canonical(drawn.get(name))] + [
        f"{room.ledger}: {name}, which the seed of the round gives, is missing; or {room.plan} was changed"
        for name in drawn if name not in ours and not so_far]


def check_world(room: Room, world: str, done: Mapping[str, str]) -> list[str]:
    """Return a sentence for each change after the commitment: of seal, data and claims."""
    seal = load_seal(room.seal(world))
    wrong = [] if seal.commitment == done.get(Step.SEALED) else [f"{room.seal(world)}: is not what was sealed"]
    if seal.world.get("name") != world:
        wrong.append(f"{room.seal(world)}: world: name: is not {world!r}")
    if Step.OPENED in done and digest(room.seal(world).read_bytes()) != done[Step.OPENED]:
        wrong.append(f"{room.seal(world)}: is not what was opened")
    wrong += check_data(seal, room.data(world))
    if Step.CLAIMED in done:
        wrong += _check_claims(room.claims(world), done[Step.CLAIMED], seal.data)
    return wrong


def _check_claims(path: Path, claimed: str, data: dict[str, str]) -> list[str]:
    text = path.read_bytes() if path.is_file() else b""
    if digest(text) != claimed:
        return [f"{path}: is not what was claimed" if text else f"{path}: is missing"]
    return [] if load_claims(path).data == data else [f"{path}: claims are about other data than were given"]


def mark_world(root: Path, drawn: Drawn) -> Graded:
    """Return one world's marks; drawn: what was sealed."""
    room = Room(root)
    path = room.claims(drawn.name)
    claims = load_claims(path)
    measured = measure(drawn, load_dataset(room.data(drawn.name)), claims.believed is not None)
    unseen = shoot_unseen(drawn) if claims.believed is not None else None
    try:
        told = mark(drawn, claims.finding, measured, claims.rivals)
        if claims.believed is None or unseen is None:
            return Graded(drawn.name, told)
        before = measured.before or from_table(claims.believed.before, str(path))
        beliefs = (before, from_table(claims.believed.after, str(path)))
        return Graded(drawn.name, structs.replace(told, off_m=tuple(off_m(one, unseen) for one in beliefs)))
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        raise InputError(f"{path}: finding: {type(error).__name__}: {error}") from error


def graded_of(room: Room) -> tuple[Graded, ...]:
    """Return all marks of a round, by world, in its order. InputError if one differs from the ledger or is missing."""
    steps = room.steps()
    wrong = [*wrong_marks(room.grades, steps), *missing_marks(room.grades, steps)]
    if wrong:
        raise InputError("\n".join(wrong))
    return tuple({line["world"]: msgspec.convert(line, Graded) for line in lines_of(room.grades)}.values())
