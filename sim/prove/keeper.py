"""The keeper's part: draw worlds, make and give away their data, and commit to what is true of them before."""

import secrets
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path

import msgspec
from msgspec import Struct

from robot.config import BadInput
from sim.fanout import fan_out
from sim.prove.ledger import append
from sim.prove.making import home_of, make_data
from sim.prove.mix import FIRST_SEED, MUJOCO, NUMPY, Drawn, draw_round
from sim.prove.room import SEALED, Room
from sim.prove.seal import make_seal, save_seal

Progress = Callable[[float, str], None]
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
