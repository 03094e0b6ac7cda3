"""A finished round in one file, without its data: the opened seals say how to make them again, to the last byte."""

import io
import shutil
import tarfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec

from robot.config import BadInput
from sim.prove.keeper import asked_of, load_plan
from sim.prove.ledger import digest
from sim.prove.making import HOME, make_data, make_more
from sim.prove.mix import OWN, Drawn, drawn_of
from sim.prove.opener import Progress, check_world, graded_of, mark_world
from sim.prove.room import ANSWERED, CLAIMED, CLAIMED_AGAIN, GRADED, SEALED, Room
from sim.prove.same_mark import TOLERANCE, compare
from sim.prove.seal import canonical, load_seal

KEPT = ("ledger.jsonl", "grades.jsonl", "keeper", "claims", "again")


class Checked(NamedTuple):
    """What was found of a packed round; `wrong` names all that is not as it was committed to; off: how far numbers of
    the marks that were worked out again are off at most (sim.prove.same_mark)."""

    sealed: int
    graded: int
    remade: tuple[str, ...]
    wrong: tuple[str, ...]
    off: Mapping[str, float]


def pack(room: Room, path: Path) -> None:
    """Write a .tar.xz of all but the data; BadInput for a round with worlds that are not marked yet, or are not ours.

    Somebody else's worlds can be made again by nobody else.
    """
    open_yet = [name for name, done in room.steps().items() if name != HOME and GRADED not in done]
    if open_yet:
        raise BadInput(f"{room.ledger}: {', '.join(open_yet[:5])}: not marked yet; `truearc prove grade` first")
    if any(_drawn(room, name).engine == OWN for name in room.steps()):
        raise BadInput(f"{room.ledger}: has somebody else's world, whose data cannot be made again: keep the directory")
    files = [file for name in KEPT for file in sorted([room.root / name, *(room.root / name).rglob("*")])
             if file.is_file()]
    with tarfile.open(path, "w:xz", preset=9) as tar:
        for file in files:
            entry = tarfile.TarInfo(file.relative_to(room.root).as_posix())     # no owner, no time of day
            data = file.read_bytes()
            entry.size = len(data)
            tar.addfile(entry, io.BytesIO(data))


def unpack(path: Path, room: Room) -> None:
    """BadInput where the directory is there already, or the file is no packed round."""
    if room.root.exists():
        raise BadInput(f"{room.root}: is there already")
    try:
        with tarfile.open(path, "r:xz") as tar:
            tar.extractall(room.root, filter="data")
    except (OSError, tarfile.TarError, EOFError) as error:
        raise BadInput(f"{path}: {error}") from error
    if not room.ledger.is_file():
        raise BadInput(f"{path}: has no ledger.jsonl: no round was packed there")


def check_round(room: Room, worlds: int, progress: Progress) -> Checked:
    """Make the data of `worlds` worlds again, spread over the round, compare all hashes, and mark them again.

    Of all: that their seals, claims and marks are, to the letter, those in the ledger, and that they were drawn from
    the seed.
    """
    steps = room.steps()
    wrong = [line for name, done in steps.items() for line in _check_papers(room, name, done)]
    wrong += [*_check_draw(room, steps), *_check_marks(room, steps)]
    names = [name for name in steps if name != HOME]
    chosen, marked = _spread(names, worlds), {one.world: one for one in graded_of(room)}
    off = dict.fromkeys(TOLERANCE, 0.0)
    for number, name in enumerate([*([HOME] if HOME in steps else []), *chosen]):
        progress(number / (len(chosen) + 1), f"{name} is made again")
        changed = _remake(room, name, steps[name])
        wrong += changed
        if name in marked and not changed:
            compared = compare(marked[name], mark_world(room.root, name))
            wrong += [f"{room.claims(name)}: is marked otherwise now: {one}" for one in compared.other]
            off = {number: max(far, compared.off[number]) for number, far in off.items()}
    progress(1.0, f"{len(chosen)} worlds made again")
    return Checked(len(steps), sum(GRADED in done for done in steps.values()), chosen, tuple(dict.fromkeys(wrong)), off)


def _remake(room: Room, name: str, done: dict[str, str]) -> list[str]:
    drawn = _drawn(room, name)
    for directory in (room.data(name), room.more(name)):
        shutil.rmtree(directory, ignore_errors=True)
        directory.parent.mkdir(parents=True, exist_ok=True)
    make_data(drawn, room.data(name))
    if ANSWERED in done:
        make_more(drawn, asked_of(room, name), room.more(name))
    return check_world(room, name, done)


def _check_papers(room: Room, name: str, done: dict[str, str]) -> list[str]:
    wrong = [] if load_seal(room.seal(name)).commitment == done.get(SEALED) else [
        f"{room.seal(name)}: is not what was sealed"]
    for step, path in ((CLAIMED, room.claims(name)), (CLAIMED_AGAIN, room.again(name))):
        if step in done and (not path.is_file() or digest(path.read_bytes()) != done[step]):
            wrong.append(f"{path}: is not what was claimed")
    return wrong


def _check_marks(room: Room, steps: dict[str, dict[str, str]]) -> list[str]:
    marked = {one.world: digest(canonical(msgspec.to_builtins(one))) for one in graded_of(room)}
    return [f"{room.grades}: {name} is not marked as the ledger has it" for name, done in steps.items()
            if marked.get(name) != done.get(GRADED)]


def _check_draw(room: Room, steps: dict[str, dict[str, str]]) -> list[str]:
    """Whether the worlds are all those that the seed gives, and none was left out for what came of it."""
    drawn = {one.name: msgspec.to_builtins(one) for one in load_plan(room).drawn()}
    return [f"{room.seal(name)}: is not what the seed of the round gives" for name in steps
            if canonical(load_seal(room.seal(name)).world) != canonical(drawn.get(name))] + [
        f"{room.ledger}: {name}, which the seed of the round gives, is missing" for name in drawn if name not in steps]


def _drawn(room: Room, name: str) -> Drawn:
    return drawn_of(load_seal(room.seal(name)).world, room.seal(name))


def _spread(names: Sequence[str], count: int) -> tuple[str, ...]:
    count = min(count, len(names))
    return tuple(names[place * len(names) // count] for place in range(count))
