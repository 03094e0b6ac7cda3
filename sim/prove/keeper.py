"""The keeper's part: draw worlds, make and give away their data, and commit to what is true of them before."""

import secrets
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
from msgspec import Struct

from robot.config import BadInput
from sim.fanout import fan_out
from sim.prove.ledger import append, digest
from sim.prove.making import home_of, make_data, make_more
from sim.prove.mix import FIRST_SEED, MUJOCO, NUMPY, OWN, Drawn, draw_round, drawn_of
from sim.prove.room import ANSWERED, ASKED, CLAIMED, OPENED, SEALED, Room
from sim.prove.seal import canonical, hash_files, load_seal, make_seal, save_seal
from sim.prove.truth.follow import Asked
from sim.shots import load_dataset

Progress = Callable[[float, str], None]
MOST_CONFIGURATIONS, MOST_SHOTS = 5, 100     # of a follow-up
AT_ONCE = 8                           # worlds made between two entries in the ledger


class Plan(Struct, frozen=True, forbid_unknown_fields=True):
    """What a round is drawn from."""

    seed: int
    worlds: int
    level: str
    shots: int
    engines: tuple[str, ...] = (NUMPY, MUJOCO)

    def drawn(self) -> tuple[Drawn, ...]:
        """Its worlds, MuJoCo's unmodified session first where there is one."""
        worlds = draw_round(self.seed, self.worlds, self.level, self.shots, self.engines)
        home = home_of(worlds, FIRST_SEED + self.seed % FIRST_SEED)
        return worlds if home is None else (home, *worlds)


def entropy() -> int:
    """A number that nobody knows beforehand."""
    return secrets.randbits(62)


def seal_round(room: Room, plan: Plan, progress: Progress, workers: int | None = None,
               scheduler: str | None = None) -> None:
    """Make and seal every world that is not sealed yet. BadInput where the round was begun from another plan."""
    room.keeper.mkdir(parents=True, exist_ok=True)
    if room.plan.exists() and load_plan(room) != plan:
        raise BadInput(f"{room.plan}: this round was drawn from something else; give another directory")
    room.plan.write_bytes(msgspec.json.encode(plan) + b"\n")
    done, worlds = room.steps(), plan.drawn()
    todo = [one for one in worlds if SEALED not in done.get(one.name, {})]
    for first in range(0, len(todo), AT_ONCE):
        batch = todo[first:first + AT_ONCE]
        progress((len(worlds) - len(todo) + first) / len(worlds), "worlds are made and sealed")
        makers = fan_out(partial(_make, room.root.resolve()), batch, scheduler, workers=workers)
        for drawn, maker in zip(batch, makers, strict=True):
            seal = make_seal(msgspec.to_builtins(drawn), maker, room.data(drawn.name))
            save_seal(room.seal(drawn.name), seal)
            append(room.ledger, SEALED, drawn.name, seal.commitment)
    progress(1.0, f"{len(worlds)} worlds sealed")


def seal_own(room: Room, world: Path, data: Path) -> str:
    """Seal a world that somebody else has made, with its data; its commitment, to be told before the data are.

    world: JSON, {"kind": "one", "effects": {"wind_x": 2.0}} and whatever else is true of it; kinds are those of
    sim.prove.mix, effects the catalogue's parameters' values, or names of their own for what no catalogue has.
    BadInput for a file that is no such thing, a directory that is no dataset, or one of that name sealed already.
    """
    try:
        truth = msgspec.json.decode(world.read_bytes(), type=dict[str, Any])
    except (OSError, msgspec.MsgspecError) as error:
        raise BadInput(f"{world}: {error}") from error
    name, dataset = data.resolve().name, load_dataset(data)
    if name in room.steps():
        raise BadInput(f"{room.ledger}: {name} is sealed already")
    level = "L2" if dataset.tracks is not None else "L1" if dataset.traces is not None else "L0"
    whole = {**truth, "name": name, "engine": OWN, "level": level, "shots": len(dataset.shots), "seed": 0}
    drawn_of(whole, world)
    room.keeper.mkdir(parents=True, exist_ok=True)
    shutil.copytree(data, room.data(name))
    seal = make_seal(whole, "somebody else", room.data(name))
    save_seal(room.seal(name), seal)
    append(room.ledger, SEALED, name, seal.commitment)
    return seal.commitment


def answer_round(room: Room, progress: Progress, workers: int | None = None, scheduler: str | None = None) -> None:
    """Shoot what the solver has asked for, in every world that is claimed and not opened yet."""
    steps = room.steps()
    todo = [name for name, done in steps.items() if CLAIMED in done and not {ANSWERED, OPENED} & set(done)]
    asked = {name: asked_of(room, name) for name in todo if _ours(room, name)}
    todo = [name for name in todo if asked.get(name)]
    for first in range(0, len(todo), AT_ONCE):
        batch = todo[first:first + AT_ONCE]
        progress(first / len(todo), "more shots are given")
        for name in batch:
            if ASKED not in steps[name]:
                append(room.ledger, ASKED, name, digest(canonical([one._asdict() for one in asked[name]])))
        fan_out(partial(_answer, room.root.resolve()), batch, scheduler, workers=workers)
        for name in batch:
            append(room.ledger, ANSWERED, name, digest(canonical(hash_files(room.more(name)))))
    progress(1.0, f"{len(todo)} worlds shot again")


def asked_of(room: Room, world: str) -> list[Asked]:
    """What a world's claims ask for; BadInput for more than the rules allow."""
    path = room.claims(world)
    try:
        asked = [Asked(**one) for one in msgspec.json.decode(path.read_bytes())["asked"]]
    except (OSError, msgspec.DecodeError, KeyError, TypeError) as error:
        raise BadInput(f"{path}: asked: {error}") from error
    if len(asked) > MOST_CONFIGURATIONS or sum(one.shots for one in asked) > MOST_SHOTS or any(
            one.shots < 1 for one in asked):
        raise BadInput(f"{path}: asked: at most {MOST_CONFIGURATIONS} configurations and {MOST_SHOTS} shots")
    return asked


def _ours(room: Room, world: str) -> bool:
    """Whether an engine of ours can shoot it again; somebody else's worlds only they can."""
    return drawn_of(load_seal(room.seal(world)).world, room.seal(world)).engine != OWN


def _answer(root: Path, world: str) -> None:
    room = Room(root)
    directory = room.more(world)
    shutil.rmtree(directory, ignore_errors=True)
    directory.parent.mkdir(parents=True, exist_ok=True)
    make_more(drawn_of(load_seal(room.seal(world)).world, room.seal(world)), asked_of(room, world), directory)


def load_plan(room: Room) -> Plan:
    """BadInput names the file and what is wrong with it."""
    try:
        return msgspec.json.decode(room.plan.read_bytes(), type=Plan)
    except OSError as error:
        raise BadInput(f"{room.plan}: {error.strerror}") from error
    except msgspec.MsgspecError as error:
        raise BadInput(f"{room.plan}: {error}") from error


def _make(root: Path, drawn: Drawn) -> str:
    """The data of one world, anew where a kill has left some."""
    directory = Room(root).data(drawn.name)
    shutil.rmtree(directory, ignore_errors=True)
    directory.parent.mkdir(parents=True, exist_ok=True)
    return make_data(drawn, directory)
