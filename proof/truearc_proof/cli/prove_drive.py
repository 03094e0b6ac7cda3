"""The whole chain in sealed worlds: the emulated robot records, the solver learns gates, the robot drives with them.

A round of its own, in ROUND/driven, with its own ledger. A world is MuJoCo's with one concealed change; its data are
recordings of the emulated robot, through its buses and camera. From them alone the solver fits the terms that rig.toml
states (the paper's physics), discovers and adopts the effects that those lack, and trains a gate on either: `before`
and `after`, alike in all else, so that they are equal where nothing was found. Then the seal is opened, and the same
robot drives in the same world without a gate and with each.
"""

import contextlib
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import msgspec
import numpy as np
from msgspec import Struct, structs

import truearc as ta
from truearc.cli.common import SHIPPED
from truearc.errors import InputError
from truearc.model_export.graph import export_weights
from truearc.model_export.verify import verify_gate
from truearc.robot.config.schema import Config, load_config
from truearc.robot.config.shot_map import OUTCOMES
from truearc.robot.recording.session import load_trials
from truearc.sim.compute import keep_compiled
from truearc.sim.data.files import save_dataset
from truearc.sim.data.recordings import shots_from_sessions
from truearc.sim.discover.finding import make_json
from truearc.sim.discover.investigate import make_belief
from truearc.sim.discover.report.finding_text import say_adopted
from truearc.sim.printed import Progress
from truearc.sim.world.emulated_robot import emulate
from truearc.sim.world.options import Options
from truearc_proof.parallel import fan_out
from truearc_proof.report.tables import said
from truearc_proof.rounds.committer import RoundPlan, keep_plan
from truearc_proof.rounds.documents import SCHEMA, canonical, hash_files, load_seal, make_seal, save_seal
from truearc_proof.rounds.grader import check_world, left_out, load_marks, save_mark, worlds_of, wrong_marks
from truearc_proof.rounds.jsonl_store import mend
from truearc_proof.rounds.ledger import Room, Step, alone, append, digest
from truearc_proof.rounds.solver import FALSE_ALARM, forbid, solver_id
from truearc_proof.table import Table, difference
from truearc_proof.worlds.sampling_plan import FIRST_SEED, MUJOCO, Drawn, change_one, drawn_of

LEVEL = "L1"
FEWEST = 30                           # trials of practice
AT_ONCE = 4                           # worlds between two entries in the ledger
NO_GATE, SIDES = "no gate", ("before", "after")
Done = TypeVar("Done")
Score = tuple[int, int]               # how many scored, of how many


class Driven(Struct, frozen=True):
    """One world: (threes, fired) without a gate and with either, and what discovery had said of it."""

    world: str
    change: str
    verdict: str
    names: tuple[str, ...]
    scored: dict[str, Score]


def room_of(root: Path) -> Room:
    """Where the driven worlds of a round are."""
    return Room(root / "driven")


def play_driven(
    root: Path, plan: RoundPlan, trials: int, progress: Progress, workers: int | None = None
) -> list[Driven]:
    """Seal the plan's worlds, as many trials each as it has shots, have gates learnt by a process that is refused the
    seals, open, and drive `trials` with each gate; nothing is done twice. InputError for whatever was tampered with,
    and for a round that was begun from another plan."""
    room = room_of(root)
    names = [f"r{number:04d}" for number in range(1, plan.worlds + 1)]
    with alone(room.root):
        keep_plan(room, plan)
        _in_batches([name for name in names if Step.SEALED not in room.steps().get(name, {})],
                    partial(_seal, room.root.resolve(), plan),
                    lambda name, sha256: append(room.ledger, Step.SEALED, name, sha256),
                    lambda done: progress(0.3 * done, "the emulated robot records"), workers)
    progress(0.3, "gates are learnt")
    more = ["--processes", str(workers)] if workers else []
    if subprocess.run([sys.executable, "-m", "truearc", "prove", "gates", "--out", str(root), *more],
                      check=False).returncode:
        raise InputError(f"{room.root}: no gates were learnt; the reason is above")
    with alone(room.root):
        _open(room, names)
        steps, known = room.steps(), worlds_of(room.grades)
        _in_batches([name for name in names if name not in known], partial(_drive, room.root.resolve(), trials),
                    lambda name, driven: save_mark(room, name, driven, steps[name]),
                    lambda done: progress(0.5 + 0.5 * done, "the robot drives"), workers)
    return driven_of(room)


def _in_batches(names: Sequence[str], work: Callable[[str], Done], enter: Callable[[str, Done], object],
                progress: Callable[[float], None], workers: int | None) -> None:
    """Work, and enter what came of it, a few worlds at a time."""
    for first in range(0, len(names), AT_ONCE):
        progress(first / len(names))
        batch = names[first:first + AT_ONCE]
        for name, done in zip(batch, fan_out(work, batch, workers=workers), strict=True):
            enter(name, done)


def _seal(root: Path, plan: RoundPlan, name: str) -> str:
    """Record a practice session in a world that is drawn from seed and name; the commitment to it."""
    room, rng = Room(root), np.random.default_rng([plan.seed, *name.encode()])
    drawn = change_one(rng, Drawn(name, MUJOCO, "one", LEVEL, plan.shots, FIRST_SEED + int(rng.integers(1 << 40))))
    session = _session(room, name, "practice")
    for old in (session, room.data(name)):
        shutil.rmtree(old, ignore_errors=True)
    emulate(load_config(SHIPPED), session, plan.shots, drawn.seed, _options(drawn))
    save_dataset(room.data(name), shots_from_sessions([session], name))
    seal = make_seal(msgspec.to_builtins(drawn), "the emulated robot", room.data(name))
    save_seal(room.seal(name), seal)
    return seal.commitment


def learn_gates(root: Path, workers: int | None = None) -> None:
    """The solver's part, in a process of its own: gates and claims for every sealed world that has none."""
    room = room_of(root)
    forbid(room.keeper)
    with alone(room.root):
        _in_batches([name for name, done in room.steps().items() if Step.CLAIMED not in done],
                    partial(_learn, room.root.resolve()),
                    lambda name, sha256: append(room.ledger, Step.CLAIMED, name, sha256), lambda done: None, workers)


def _learn(root: Path, name: str) -> str:
    """Both gates from the recordings, as anyone could with the Python API; the claims' hash."""
    room = Room(root)
    forbid(room.keeper)
    keep_compiled()
    data, folder = room.data(name), room.root / "gates" / name
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    shots = ta.load_dataset(data)
    found = ta.discover(shots, false_alarm=FALSE_ALARM, seed=0)
    steps = found.investigation.steps
    with (folder / "steps.txt").open("w", encoding="utf-8") as said_here, contextlib.redirect_stdout(said_here):
        for side, taken in zip(SIDES, ((), steps), strict=True):
            belief, provenance = make_belief(replace(found.investigation, steps=taken))
            replace(belief, provenance={"dataset": found.name, **provenance}).save(folder / f"{side}.toml")
            print(say_adopted(found.record, provenance))
            _train(shots, belief, folder / f"{side}_weights", _gate(room, name, side))
    claims = {"schema": SCHEMA, "world": name, "solver": solver_id(), "data": hash_files(data),
              "finding": msgspec.json.decode(make_json(found.record)), "gates": _gate_hashes(room, name)}
    text = canonical(claims) + b"\n"
    room.claims(name).parent.mkdir(exist_ok=True)
    room.claims(name).write_bytes(text)
    return digest(text)


def _train(shots: ta.Dataset, belief: ta.Belief, weights: Path, gate: Path) -> None:
    """Train, export, and check the file against its trainer; InputError where a check fails."""
    training = ta.train_gate(shots, belief)
    training.save(weights)
    export_weights(weights, gate)
    found = verify_gate(gate, weights, {shots.name: shots})
    print(training, found, sep="\n")
    if not found.passed:
        raise InputError(f"{gate}: not what was trained")


def _open(room: Room, names: Sequence[str]) -> None:
    """Enter in the ledger that seals are opened; InputError where anything was tampered with."""
    mend(room.grades)
    steps = room.steps()
    wrong = [line for name, done in steps.items() for line in check_world(room, name, done)]
    wrong += [*left_out(room, steps), *wrong_marks(room.grades, steps)]
    if wrong:
        raise InputError("\n".join(wrong))
    wrong = [f"{_gate(room, name, side)}: is not what was claimed" for name in names
             for side, sha256 in _claimed_gates(room, name).items() if _gate_hashes(room, name)[side] != sha256]
    if wrong:
        raise InputError("\n".join(wrong))
    for name in names:
        if Step.OPENED not in steps[name]:
            append(room.ledger, Step.OPENED, name, digest(room.seal(name).read_bytes()))


def _claimed_gates(room: Room, name: str) -> dict[str, str]:
    """{side: SHA-256}; InputError where the claims do not say it of both sides."""
    gates = msgspec.json.decode(room.claims(name).read_bytes()).get("gates")
    if not isinstance(gates, dict) or set(gates) != set(SIDES):
        raise InputError(f"{room.claims(name)}: gates: must have {' and '.join(SIDES)}")
    return gates


def walked_in(config: Config, session: Path) -> Config:
    """The configuration with the aim as the driver's marks left it at the end of a session."""
    walk = (0.0, 0.0, 0.0)
    for tick in ta.Recording(session):
        walk = tick.memory.walk
    return structs.replace(config, collect=structs.replace(config.collect, walk_start=walk))


def _drive(root: Path, trials: int, name: str) -> Driven:
    """Drive three times in the same world with the same driver, without a gate and with each of the two gates."""
    room = Room(root)
    drawn = drawn_of(load_seal(room.seal(name)).world, room.seal(name))
    config = walked_in(load_config(SHIPPED), _session(room, name, "practice"))
    scored = {}
    for side in (NO_GATE, *SIDES):
        session = _session(room, name, side)
        shutil.rmtree(session, ignore_errors=True)
        emulate(config, session, trials, drawn.seed + 1, _options(drawn),
                None if side == NO_GATE else _gate(room, name, side))
        outcomes = [OUTCOMES[trial.outcome.outcome][0] for trial in load_trials(session)
                    if trial.outcome.outcome in OUTCOMES and trial.shot is not None]
        scored[side] = outcomes.count("three"), len(outcomes)
    finding = msgspec.json.decode(room.claims(name).read_bytes())["finding"]
    return Driven(name, drawn.change, finding["verdict"], tuple(one["term"] for one in finding["what"][:1]), scored)


def driven_of(room: Room) -> list[Driven]:
    """Return the driven worlds on file, in order; InputError where a line differs from the ledger."""
    lines = [msgspec.convert(line, Driven) for line in load_marks(room)]
    return [one for _, one in sorted({one.world: one for one in lines}.items())]


def driven_table(driven: Sequence[Driven]) -> Table:
    """Worlds, then all together with the difference of the two gates (Newcombe's 95 %)."""
    sides = (NO_GATE, *SIDES)
    rows = [[one.world, one.change, one.verdict, ", ".join(one.names),
             *(f"{one.scored[side][0]} of {one.scored[side][1]}" for side in sides)] for one in driven]
    total = {side: (sum(one.scored[side][0] for one in driven), sum(one.scored[side][1] for one in driven))
             for side in sides}
    low, high = difference(total["after"], total["before"])
    rows.append(["together", "", "", f"after - before: {low:+.0%} to {high:+.0%} (95 %)",
                 *(said(*total[side]) for side in sides)])
    return Table("Driven: three points of shots fired, in sealed worlds of the emulated robot", (
        "world", "changed", "verdict", "first name", NO_GATE, "the paper's physics", "what was adopted"), rows)


def _options(drawn: Drawn) -> Options:
    return msgspec.convert(drawn.effects, Options)


def _session(room: Room, name: str, which: str) -> Path:
    return room.root / "sessions" / name / which.replace(" ", "_")


def _gate(room: Room, name: str, side: str) -> Path:
    return room.root / "gates" / name / f"{side}.onnx"


def _gate_hashes(room: Room, name: str) -> dict[str, str]:
    return {side: digest(_gate(room, name, side).read_bytes()) for side in SIDES}
