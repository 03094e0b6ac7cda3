"""The solver's part: discovery on data whose truth is sealed. It can open no file of the keeper's, nor the ledger's.

That is enforced where it runs (an audit hook of the interpreter, which cannot be taken off again), so that nobody has
to take it on trust that no seal was read.
"""

import hashlib
import os
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import msgspec

import sim
from robot.config import BadInput
from sim.belief import Belief
from sim.discover.adopt import make_belief
from sim.discover.discover import discover
from sim.discover.finding import make_json
from sim.fanout import fan_out
from sim.prove.ledger import append, digest
from sim.prove.making import HOME
from sim.prove.room import CLAIMED, SEALED, Room
from sim.prove.seal import canonical, hash_files
from sim.shots import load_dataset

Progress = Callable[[float, str], None]
SCHEMA = "truearc.claims/1"
FALSE_ALARM = 0.05
AT_HOME = ("gravity", "drag", "magnus")      # what is believed of MuJoCo's robot before its unmodified session
AT_ONCE = 8                           # worlds solved between two entries in the ledger
OPENING = ("open", "os.listdir", "os.scandir", "os.rename", "os.link", "os.symlink")
ROOMS = ("discover", "physics", "fit")       # whose sources say which solver it was

_forbidden: list[str] = []


def solve_round(room: Room, progress: Progress, workers: int | None = None, scheduler: str | None = None) -> None:
    """Claims for every sealed world that has none in the ledger. Call it in a process of its own: afterwards this one
    can open nothing of the keeper's any more."""
    steps = room.steps()
    names = [name for name, done in steps.items() if SEALED in done and name != HOME]
    todo = [name for name in names if CLAIMED not in steps[name]]
    forbid(room.keeper)
    for first in range(0, len(todo), AT_ONCE):
        batch = todo[first:first + AT_ONCE]
        progress((len(names) - len(todo) + first) / len(names), "worlds are discovered in")
        fan_out(partial(solve, room.root.resolve()), batch, scheduler, workers=workers)
        for name in batch:
            append(room.ledger, CLAIMED, name, digest(room.claims(name).read_bytes()))
    progress(1.0, f"{len(names)} worlds claimed")


def solve(root: Path, world: str) -> None:
    """One world's claims, written whole or not at all."""
    room = Room(root)
    forbid(room.keeper)
    directory = room.data(world)
    dataset = load_dataset(directory)
    belief = None if dataset.facts.believe.terms else home_belief(room.data(HOME))
    finding = discover(dataset, None, FALSE_ALARM, 0, belief=belief).finding
    claims = {"schema": SCHEMA, "world": world, "solver": solver_id(), "data": hash_files(directory),
              "finding": msgspec.json.decode(make_json(finding))}
    path = room.claims(world)
    path.parent.mkdir(exist_ok=True)
    half = path.with_suffix(".half")
    half.write_bytes(canonical(claims) + b"\n")
    os.replace(half, path)


@cache
def home_belief(directory: Path) -> Belief:
    """What the unmodified robot's session leaves to be believed; effects without a name are left out."""
    if not directory.is_dir():
        raise BadInput(f"{directory}: is missing: these worlds are to be compared with it")
    found = discover(load_dataset(directory), AT_HOME, FALSE_ALARM, 0)
    return make_belief(replace(found, steps=tuple(step for step in found.steps if not step.unknown)))[0]


@cache
def solver_id() -> str:
    """SHA-256 of the solver's sources: the same as long as not a letter of it has changed."""
    state = hashlib.sha256()
    for path in sorted(path for name in ROOMS for path in (Path(sim.__file__).parent / name).rglob("*.py")):
        state.update(path.relative_to(Path(sim.__file__).parent).as_posix().encode() + b"\0" + path.read_bytes())
    return state.hexdigest()


def forbid(directory: Path) -> None:
    """From now on nothing in this process opens anything in there: PermissionError."""
    if not _forbidden:
        sys.addaudithook(_refuse)
    _forbidden.append(os.path.realpath(directory))


def _refuse(event: str, args: tuple[Any, ...]) -> None:
    if event not in OPENING or not args or not isinstance(args[0], str | bytes | os.PathLike):
        return
    path = os.path.realpath(os.fsdecode(args[0]))
    if any(path == one or path.startswith(one + os.sep) for one in _forbidden):
        raise PermissionError(f"{path}: is sealed")
