"""The solver of a round, which runs discovery on data whose truth is sealed and opens none of the keeper's files.

A permanent interpreter audit hook blocks any attempt to open such a file. It guards against accidents, not against
malice: a subprocess, ctypes, or a library that opens files itself can bypass it. To run an untrusted solver, give it a
copy of the round without keeper/, which is all that it needs (docs/how-to/challenge.md).

Workers return claims by value and this process writes them, so that a worker that outlives a killed solver cannot write
at the same time as the next solver.
"""

import hashlib
import os
import sys
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from types import ModuleType
from typing import Any

import msgspec

import truearc as ta
import truearc.api
import truearc.sim
import truearc_proof
from truearc.sim.check.check import CHECKS
from truearc.sim.discover.investigate import make_belief
from truearc.sim.infer.belief import as_table
from truearc.sim.physics.catalogue import BUILT_IN
from truearc.sim.printed import Progress
from truearc_proof.parallel import fan_out
from truearc_proof.rivals import find_rival
from truearc_proof.rivals.claim import believed_of
from truearc_proof.rounds import SCHEMA, Room, Step, alone, append, canonical, digest, hash_files
from truearc_proof.rounds.worlds import HOME

FALSE_ALARM = 0.05
AT_HOME = ("gravity", "drag", "magnus")      # what is believed of MuJoCo's robot before its unmodified session
OPENING = ("open", "os.listdir", "os.scandir", "os.rename", "os.link", "os.symlink")
# Patterns of the files below each package that the solver's hash covers; the emulated world is not among them.
SOURCES = {
    truearc.api: ("*.py",),
    truearc.sim: ("*.py", "data/**/*.py", "physics/**/*.py", "infer/**/*.py", "discover/**/*.py", "gate/**/*.py",
                  "paper/**/*.py", "sysid/**/*.py"),
    truearc_proof: ("parallel.py", "rounds/__init__.py", "rounds/solver.py"),
}

Home = tuple[ta.Dataset, ta.Belief]   # a session, and the belief from it

_forbidden: list[str] = []


def solve_round(room: Room, progress: Progress, workers: int | None = None,
                rivals: tuple[str, ...] = ()) -> None:
    """Make claims for every sealed world without one in the ledger.

    rivals: others (truearc_proof.rivals) that receive the same tracks. Call it in a process of its own: afterwards this
    process can no longer open any of the keeper's files. InputError for rivals if no world has tracks.
    """
    forbid(room.keeper)
    with alone(room.root):
        _solve_sealed(room, progress, workers, rivals)


def _solve_sealed(room: Room, progress: Progress, workers: int | None, rivals: tuple[str, ...]) -> None:
    steps = room.steps()
    names = [name for name, done in steps.items() if Step.SEALED in done and Step.OPENED not in done and name != HOME]
    if rivals and names and not any(any(room.data(name).glob("tracks.*")) for name in names):
        raise ta.InputError(f"--rivals: {room.root / 'data'}: no world has tracks, and others are put to tracks alone")
    todo = [name for name in names if Step.CLAIMED not in steps[name]]
    home = None
    if todo and room.data(HOME).is_dir():         # once, not once a worker: it takes minutes
        progress(0.0, "the unmodified robot's session is discovered in")
        session = ta.load_dataset(room.data(HOME))
        home = session, _believed_after(session)
    fan_out(partial(solve, room.root.resolve(), rivals, home), todo,
            lambda done, note: progress(done, "worlds are discovered in"), workers, partial(_claim, room))
    progress(1.0, f"{len(names)} worlds claimed")


def _claim(room: Room, world: str, claims: dict[str, Any]) -> None:
    """Written and entered, as soon as it is there."""
    _write(room.claims(world), claims)
    append(room.ledger, Step.CLAIMED, world, digest(room.claims(world).read_bytes()))


def solve(root: Path, rivals: tuple[str, ...], home: Home | None, world: str) -> dict[str, Any]:
    """Return one world's claims, and those of rivals if there are tracks. home: of MuJoCo's unmodified robot."""
    room = Room(root)
    forbid(room.keeper)
    directory = room.data(world)
    dataset = ta.load_dataset(directory)
    found = _discover(room, world, dataset, home)
    claims = {"schema": SCHEMA, "world": world, "solver": solver_id(), "data": hash_files(directory),
              "finding": msgspec.json.decode(found.to_json()), **believed_by(found)}
    believed = believed_of(found.investigation)
    if rivals and dataset.tracks is not None and believed is not None:
        claims["rivals"] = {name: msgspec.to_builtins(find_rival(name)(dataset, believed, 0)) for name in rivals}
    return claims


def believed_by(found: ta.Finding) -> dict[str, Any]:
    """Return the beliefs before and after the finding, which the sealed test compares by their forecasts."""
    if not found.investigation.steps:
        return {}
    before = make_belief(replace(found.investigation, steps=()))[0]
    after = make_belief(found.investigation, found.investigation.choice)[0]
    return {"believed": {"before": as_table(before), "after": as_table(after)}}


def _discover(room: Room, world: str, dataset: ta.Dataset, home: Home | None) -> ta.Finding:
    if (room.data(world) / HOME).is_dir():                       # a foreign world's own practice
        practice = ta.load_dataset(room.data(world) / HOME)
        return _ask(dataset, belief=_believed_after(practice), since=practice)
    if dataset.rig.believe.terms:
        return _ask(dataset)
    if home is None:
        raise ta.InputError(f"{room.data(HOME)}: is missing: these worlds are to be compared with it")
    return _ask(dataset, belief=home[1], since=home[0])


def _ask(dataset: ta.Dataset, **known: Any) -> ta.Finding:
    """A finding of the built-in terms; what a plausibility check objects to is the world's own doing, and is noted."""
    return ta.discover(dataset, terms=BUILT_IN, seed=0, false_alarm=FALSE_ALARM, accept=CHECKS, **known)


def _write(path: Path, claims: dict[str, Any]) -> None:
    """Whole or not at all."""
    path.parent.mkdir(exist_ok=True)
    half = path.with_suffix(".half")
    half.write_bytes(canonical(claims) + b"\n")
    os.replace(half, path)


def _believed_after(home: ta.Dataset) -> ta.Belief:
    return make_belief(_ask(home, believe=None if home.rig.believe.terms else AT_HOME).investigation)[0]


@cache
def solver_id() -> str:
    """Return the SHA-256 of the sources that claims depend on (`SOURCES`)."""
    state = hashlib.sha256()
    for name, path in solver_files(SOURCES):
        state.update(name.encode() + b"\0" + path.read_bytes())
    return state.hexdigest()


def solver_files(sources: Mapping[ModuleType, Iterable[str]]) -> list[tuple[str, Path]]:
    """Return (name, path) of every file that the patterns match, sorted by name.

    Raises:
        ValueError: a pattern matches no file, so that a file that has moved cannot leave the hash unseen.
    """
    files: dict[str, Path] = {}
    for package, patterns in sources.items():
        home = Path(str(package.__file__)).parent
        for pattern in patterns:
            found = {f"{package.__name__}/{path.relative_to(home).as_posix()}": path for path in home.glob(pattern)}
            if not found:
                raise ValueError(f"{package.__name__}: {pattern} matches no file")
            files |= found
    return sorted(files.items())


def forbid(directory: Path) -> None:
    """Prevent this process from now on from opening anything in there: PermissionError."""
    if not _forbidden:
        sys.addaudithook(_refuse)
    _forbidden.append(os.path.realpath(directory))


def _refuse(event: str, args: tuple[Any, ...]) -> None:
    if event not in OPENING or not args or not isinstance(args[0], str | bytes | os.PathLike):
        return
    path = os.path.realpath(os.fsdecode(args[0]))
    if any(path == one or path.startswith(one + os.sep) for one in _forbidden):
        raise PermissionError(f"{path}: is sealed")
