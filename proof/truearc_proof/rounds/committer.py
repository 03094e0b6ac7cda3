"""The keeper of a round, which draws worlds, commits to their truth, and makes and releases their data.

Only the keeper's process opens seals. Its workers receive the parts that they need, and write into a directory of their
own (Room.half), which is moved into place when it is complete. A worker that outlives a killed keeper thus cannot
corrupt the next keeper's data.

For external worlds, the truth stated by their makers is sealed with their data. A truth against which no claim could be
graded is refused.
"""

import os
import secrets
import shutil
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
from msgspec import Struct

from truearc.errors import InputError, load_bytes, naming
from truearc.sim.data.dataset import Dataset
from truearc.sim.data.files import load_dataset
from truearc.sim.infer.likelihood.data import FEWEST_SHOTS
from truearc.sim.physics.catalogue import TERMS
from truearc.sim.printed import Progress
from truearc_proof.parallel import fan_out
from truearc_proof.rounds import (
    Room,
    Step,
    alone,
    append,
    check_data,
    load_seal,
    make_seal,
    save_seal,
)
from truearc_proof.rounds.worlds import (
    ENGINES,
    FIRST_SEED,
    HOME,
    OWN,
    PARAMETER,
    Drawn,
    draw_round,
    drawn_of,
    home_of,
    make_data,
)

AT_ONCE = 8                           # worlds made between two entries in the ledger
TAKEN = (HOME, "round")               # home: MuJoCo's unmodified robot; keeper/round.json: how a round was drawn
EFFECTS = {"clean": (0, 0), "dirty": (0, 0), "one": (1, 1), "alias": (1, 1), "decoy": (1, 1), "two": (2, 2),
           "off": (1, None)}          # of a kind, at least and at most


class RoundPlan(Struct, frozen=True, forbid_unknown_fields=True):
    """The parameters that a round is drawn from."""

    seed: int
    worlds: int
    level: str
    shots: int
    engines: tuple[str, ...] = ENGINES
    entropy: bool = False             # the seed was drawn, not chosen, by the keeper's own statement

    def drawn(self) -> tuple[Drawn, ...]:
        """Return its worlds, with MuJoCo's unmodified session first if there is one."""
        worlds = draw_round(self.seed, self.worlds, self.level, self.shots, self.engines)
        home = home_of(worlds, FIRST_SEED + self.seed % FIRST_SEED)
        return worlds if home is None else (home, *worlds)


def entropy() -> int:
    """Return a number from the system's entropy, which no player can predict."""
    return secrets.randbits(62)


def seal_round(room: Room, plan: RoundPlan, progress: Progress, workers: int | None = None) -> None:
    """Make and seal every world that is not sealed yet. InputError if the round was begun from another plan."""
    worlds = plan.drawn()             # before anything is there: a plan of which nothing can be drawn leaves nothing
    with alone(room.root):
        keep_plan(room, plan)
        _seal_drawn(room, worlds, progress, workers)


def keep_plan(room: Room, plan: RoundPlan) -> None:
    """Write the plan once, completely or not at all. InputError if the round was begun from another."""
    room.keeper.mkdir(parents=True, exist_ok=True)
    if not room.plan.exists():
        half = room.plan.with_suffix(".half")
        half.write_bytes(msgspec.json.encode(plan) + b"\n")
        os.replace(half, room.plan)
    elif load_plan(room) != plan:
        raise InputError(f"{room.plan}: this round was drawn from something else; give another directory")


def _seal_drawn(room: Room, worlds: tuple[Drawn, ...], progress: Progress, workers: int | None) -> None:
    done, half = room.steps(), _half(room)
    todo = [one for one in worlds if Step.SEALED not in done.get(one.name, {}) or not room.data(one.name).is_dir()]
    for first in range(0, len(todo), AT_ONCE):
        batch = todo[first:first + AT_ONCE]
        progress((len(worlds) - len(todo) + first) / len(worlds), "worlds are made and sealed")
        makers = fan_out(partial(_make, half), batch, workers=workers)
        for drawn, maker in zip(batch, makers, strict=True):
            if Step.SEALED not in done.get(drawn.name, {}):
                seal = make_seal(msgspec.to_builtins(drawn), maker, half / drawn.name)
                save_seal(room.seal(drawn.name), seal)
                append(room.ledger, Step.SEALED, drawn.name, seal.commitment)
            _move(half / drawn.name, room.data(drawn.name))      # given away once it is committed to
    progress(1.0, f"{len(worlds)} worlds sealed")


def load_plan(room: Room) -> RoundPlan:
    """Load a plan; InputError names the file and what is wrong with it."""
    with naming(room.plan):
        return msgspec.json.decode(load_bytes(room.plan), type=RoundPlan)


def _make(half: Path, drawn: Drawn) -> str:
    return make_data(drawn, _emptied(half / drawn.name))


def _half(room: Room) -> Path:
    """A directory for data in the making, which no keeper before has used; theirs are gone."""
    shutil.rmtree(room.half, ignore_errors=True)
    return room.half.resolve() / secrets.token_hex(8)


def _emptied(directory: Path) -> Path:
    """Remove whatever a lost worker has left there, and make the parent directory."""
    shutil.rmtree(directory, ignore_errors=True)
    directory.parent.mkdir(parents=True, exist_ok=True)
    return directory


def _move(made: Path, directory: Path) -> None:
    os.replace(made, _emptied(directory))


def seal_own(room: Room, world: Path, data: Path) -> str:
    """Seal an external world with its data; return its commitment, which its maker publishes before the data.

    world: JSON, {"kind": "one", "effects": {"wind_x": 2.0}} and whatever else is true of it; kinds are those of
    truearc_proof.rounds.worlds, effects the catalogue's parameters' values, or names of their own for what no
    catalogue has. InputError for what could never be marked, naming file and key, and for one of that name sealed
    already.
    """
    with naming(world):
        truth = msgspec.json.decode(load_bytes(world), type=dict[str, Any])
    name, dataset = data.resolve().name, load_dataset(data)
    level = "L2" if dataset.tracks is not None else "L1" if dataset.traces is not None else "L0"
    whole = {**truth, "name": name, "engine": OWN, "level": level, "shots": len(dataset.shots), "seed": 0}
    _check_data(room, data, dataset)
    _check_truth(world, drawn_of(whole, world))
    with alone(room.root):
        return _seal(room, name, whole, data)


def _seal(room: Room, name: str, whole: dict[str, Any], data: Path) -> str:
    sealed = room.steps().get(name)
    if sealed and room.data(name).is_dir():
        raise InputError(f"{room.ledger}: {name} is sealed already")
    if sealed:                        # a kill came before the data were given away
        seal = load_seal(room.seal(name))
        wrong = check_data(seal, data)
        if wrong:
            raise InputError("\n".join(wrong))
    else:
        room.keeper.mkdir(parents=True, exist_ok=True)
        seal = make_seal(whole, "external", data)
        save_seal(room.seal(name), seal)
        append(room.ledger, Step.SEALED, name, seal.commitment)
    _give_away(data, room.data(name))
    return seal.commitment


def _give_away(data: Path, directory: Path) -> None:
    """Whole or not at all; what was sealed where it lies is there already."""
    if data.resolve() != directory.resolve():
        half = directory.with_name(f"{directory.name}.half")
        for left in (half, directory):          # by a kill
            shutil.rmtree(left, ignore_errors=True)
        shutil.copytree(data, half)
        half.rename(directory)


def _check_data(room: Room, data: Path, dataset: Dataset) -> None:
    """InputError for data that discovery would refuse, or whose name something else has."""
    if data.resolve().name in TAKEN:
        raise InputError(f"{data}: a world cannot be called {data.resolve().name!r}, which means something else in a "
                       "round; give the directory another name")
    if len(dataset.shots) < FEWEST_SHOTS:
        raise InputError(f"{dataset.shots.source}: {len(dataset.shots)} shots; discovery takes {FEWEST_SHOTS} at least")
    if not dataset.facts.believe.terms and not room.data(HOME).is_dir():
        raise InputError(f"{data / 'rig.toml'}: believe: terms: say what is to be believed; there is nothing else to "
                       "compare the shots with")


def _check_truth(path: Path, drawn: Drawn) -> None:
    """InputError for effects that are not such as the kind has."""
    least, most = EFFECTS[drawn.kind]
    count, names = len(drawn.effects), [term.name for term in TERMS]
    if count < least or (most is not None and count > most):
        wanted = "none" if most == 0 else f"{least}" if most == least else f"{least} or more"
        raise InputError(f"{path}: effects: there are {count}; kind {drawn.kind!r} has {wanted}")
    for name, amount in drawn.effects.items():
        if name in names and name not in PARAMETER:
            raise InputError(f"{path}: effects: {name}: claims about this term cannot be marked")
        if drawn.kind == "off" and name in PARAMETER:
            raise InputError(f"{path}: effects: {name}: is in the catalogue; kind 'off' is for what is not")
        if drawn.kind != "off" and name not in PARAMETER:
            raise InputError(f"{path}: effects: {name}: the catalogue has no such term (kind 'off' is for what it does "
                           f"not have); there are {', '.join(PARAMETER)}")
        if amount == 0.0:
            raise InputError(f"{path}: effects: {name}: 0 is nothing to be found; kind 'clean' is for that")
