"""The work of `truearc prove`, role by role, and of `drive`, the whole chain in worlds of its own.

Drive has a round of its own, in ROUND/driven, with its own ledger. A world is MuJoCo's with one concealed change; its
data are recordings of the emulated robot, through its buses and camera. From them alone the solver fits the terms that
rig.toml states (the paper's physics), discovers and adopts the effects that those lack, and trains a gate on either:
`before` and `after`, alike in all else, so that they are equal where nothing was found. Then the seal is opened, and
the same robot drives in the same world without a gate and with each.
"""

import argparse
import contextlib
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import msgspec
import numpy as np
from msgspec import Struct, structs

import truearc as ta
from truearc.cli.common import SHIPPED, make_progress, origin_of
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
from truearc.sim.infer.likelihood.data import FEWEST_SHOTS
from truearc.sim.printed import Progress
from truearc.sim.world.emulated_robot import emulate
from truearc.sim.world.options import Options
from truearc_proof.parallel import fan_out, mend
from truearc_proof.rivals import check_rivals
from truearc_proof.rounds import (
    SCHEMA,
    Room,
    Step,
    alone,
    append,
    canonical,
    digest,
    hash_files,
    last_digest,
    load_seal,
    make_seal,
    read_ledger,
    save_seal,
)
from truearc_proof.rounds.archive import check_round, compare_claims, give_away, pack, solver_of, unpack
from truearc_proof.rounds.committer import RoundPlan, answer_round, entropy, keep_plan, load_plan, seal_own, seal_round
from truearc_proof.rounds.grader import (
    Graded,
    check_world,
    grade_round,
    graded_of,
    left_out,
    load_marks,
    save_mark,
    unclaimed,
    worlds_of,
    wrong_marks,
)
from truearc_proof.rounds.page import make_proof_page, verdict
from truearc_proof.rounds.solver import FALSE_ALARM, forbid, solve_round, solver_id
from truearc_proof.rounds.tables import make_tables, plain_figures, said
from truearc_proof.rounds.worlds import FIRST_SEED, MUJOCO, OWN, Drawn, change_one, drawn_of
from truearc_proof.table import Table, difference

# --- the whole chain

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


# --- roles

def solve_apart(args: argparse.Namespace, out: str) -> None:
    """The solver, in a process of its own."""
    more = ["--processes", str(args.processes)] if args.processes else []
    more += ["--scheduler", args.scheduler] if args.scheduler else []
    more += ["--quiet"] if args.quiet else []
    more += ["--rivals", args.rivals] if args.rivals and args.role is None else []
    done = subprocess.run([sys.executable, "-m", "truearc", "prove", "solve", "--out", out, *more], check=False)
    if done.returncode:
        raise InputError(f"the solver ended with exit code {done.returncode}")


def check_packed(args: argparse.Namespace, room: Room) -> None:
    """Make the data and marks of a round again and print the comparison.

    Raises:
        InputError: something differs from the commitments.
    """
    if args.packed:
        unpack(Path(args.packed), room)
    checked = check_round(room, args.worlds, make_progress("check", args.quiet), args.seed)
    if checked.wrong:
        raise InputError("\n".join(checked.wrong))
    print(f"{room.ledger}: {checked.sealed} worlds were sealed, {checked.graded} marked, as their seed draws them; "
          f"seals, claims and marks are those of the ledger.\n{len(checked.remade)} worlds made again (drawn by "
          f"--seed {checked.seed}): the same data to the last byte, and of the claims on file the same is right. "
          f"Numbers of the marks, worked out again, are off by at most "
          f"{', '.join(f'{far:.1g} ({name})' for name, far in checked.off.items())}.")
    if checked.others:
        print(f"Claimed by another state of the solver ({', '.join(one[:16] for one in checked.others)}; this is "
              f"{solver_id()[:16]}): those numbers hang on its fits, and are not held against the round.")
    print(_solve_again(args, room, checked.remade[:args.solve]) if args.solve else
          "Whether a solver says what was claimed, --solve N asks (of N of these worlds).")


def _solve_again(args: argparse.Namespace, room: Room, names: Sequence[str]) -> str:
    """What came of it; InputError for claims by another state of the solver, and where anything is claimed
    otherwise."""
    others = [name for name in names if solver_of(room, name) != solver_id()]
    if others:
        raise InputError(f"--solve: {room.claims(others[0])}: claimed by the solver whose hash is "
                       f"{solver_of(room, others[0])[:16]}; this one is {solver_id()[:16]}: check that commit out")
    with tempfile.TemporaryDirectory() as folder:
        away = give_away(room, names, Path(folder) / "away")
        solve_apart(args, str(away.root))
        wrong = [line for name in names for line in compare_claims(room, away, name)]
    if wrong:
        raise InputError("\n".join(wrong))
    return f"{', '.join(names)}: solved again from the data alone, and the same claimed."


def play_role(args: argparse.Namespace) -> int:
    """Play one role or all; args: those of `truearc prove`, defaults filled in."""
    room = Room(Path(args.out))
    _check(args)
    keep_compiled()
    if args.role in ("drive", "gates"):
        return _play_drive(args, room)
    if args.role == "pack":
        return _pack(args, room)
    if args.role == "check":
        check_packed(args, room)
        _tell(args, room, graded_of(room))
        return 0
    return _seal_own(args, room) if args.world or args.data else _play(args, room)


def _play(args: argparse.Namespace, room: Room) -> int:
    """One role, or all of them."""
    if args.role in (None, "seal"):
        seal_round(room, _plan(args, room), make_progress("seal", args.quiet), args.processes, args.scheduler)
    if args.role == "solve":
        solve_round(room, make_progress("solve", args.quiet), args.processes, args.scheduler,
                    _rivals(args))
    elif args.role is None:
        solve_apart(args, args.out)
    if args.role == "answer" or (args.role is None and args.follow_up):
        answer_round(room, make_progress("answer", args.quiet), args.processes, args.scheduler)
    if args.role is None and args.follow_up:
        solve_apart(args, args.out)
    if args.role in (None, "grade"):
        _tell(args, room, grade_round(room, make_progress("grade", args.quiet), args.processes, args.scheduler,
                                      args.so_far))
    print(f"{room.ledger}: {_head(room)}")
    return 0


def _head(room: Room) -> str:
    """What to tell the others, so that nothing in the ledger can be changed unseen from here on."""
    return f"{len(read_ledger(room.ledger))} lines, SHA-256 of the last: {last_digest(room.ledger)}"


def _play_drive(args: argparse.Namespace, room: Room) -> int:
    """The chain from recordings of the emulated robot to what its gates score; `gates` is the solver's part of it."""
    if args.role == "gates":
        learn_gates(room.root, args.processes)
    else:
        plan = structs.replace(_plan(args, room_of(room.root)), level=LEVEL, engines=(MUJOCO,))
        driven = play_driven(room.root, plan, args.trials or args.shots, make_progress("drive", args.quiet),
                             args.processes)
        print(driven_table(driven).markdown())
        _save_report(args, room, graded_of(room))
        print(f"report: {room.report}")
    return 0


def _pack(args: argparse.Namespace, room: Room) -> int:
    if not args.packed:
        raise InputError("pack: --packed FILE is needed")
    pack(room, Path(args.packed))
    print(f"{args.packed}: {len(room.steps())} worlds, {Path(args.packed).stat().st_size >> 10} KiB")
    return 0


def _check(args: argparse.Namespace) -> None:
    """InputError for numbers that no round can have, rivals that there are none of or that have nothing to be put to, a
    cluster where none is used, and a round that is not there."""
    fewest = FEWEST if args.role == "drive" else FEWEST_SHOTS
    for name, least in (("seed", 0), ("worlds", 1), ("shots", fewest), ("trials", 1), ("processes", 1), ("solve", 0)):
        value = getattr(args, name)
        if value is not None and value < least:
            raise InputError(f"--{name} {value}: {least} or more")
    check_rivals(_rivals(args))
    if args.rivals and args.role in (None, "seal") and args.level != "L2":
        raise InputError(f"--rivals: others are put to tracks alone, which --level {args.level} does not have; L2 does")
    if args.scheduler is not None and args.role in ("drive", "gates", "pack", "check"):
        raise InputError(f"--scheduler: {args.role} runs on this machine alone")
    if args.solve and (args.role != "check" or args.solve > args.worlds):
        raise InputError(f"--solve {args.solve}: with check, and no more than --worlds {args.worlds}, which are made "
                       "again")
    begun = room_of(Path(args.out)) if args.role == "gates" else Room(Path(args.out))
    unpacked = args.role == "check" and args.packed
    if args.role in ("solve", "answer", "grade", "gates", "pack", "check") and not (unpacked or begun.ledger.exists()):
        raise InputError(f"{begun.ledger}: is missing: no round was begun there")


def _rivals(args: argparse.Namespace) -> tuple[str, ...]:
    return tuple(args.rivals.split(",")) if args.rivals else ()


def _tell(args: argparse.Namespace, room: Room, graded: Sequence[Graded]) -> None:
    """The tables, and the page."""
    waiting = len(unclaimed(room.steps()))
    if waiting:
        print(f"{waiting} worlds are sealed and not claimed: they are in no table.")
    if not graded:
        print("Nothing has been marked yet.")
        return
    tables = [one.markdown() for one in _save_report(args, room, graded)]
    sealed = [f"{one.world} was sealed as {room.steps()[one.world][Step.SEALED]}: compare it with the number you were "
              "given" for one in graded if one.first.engine == OWN]
    files = f"report: {room.report}; figures: {room.figures}; every mark: {room.grades}"
    print("\n\n".join([verdict([one.first for one in graded]), *tables, *sealed, files]))


def _save_report(args: argparse.Namespace, room: Room, graded: Sequence[Graded]) -> list[Table]:
    """Write the page; its tables, that of the driven worlds among them where there are any."""
    marks, again = [one.first for one in graded], [(one.first, one.again) for one in graded if one.again is not None]
    driven = driven_of(room_of(room.root))
    tables = [*make_tables(marks, again), *([driven_table(driven)] if driven else [])]
    ledger = room.ledger if read_ledger(room.ledger) else room_of(room.root).ledger
    origin = origin_of(args)._replace(sha256=last_digest(ledger))
    room.report.write_text(make_proof_page(marks, tables, read_ledger(ledger), origin), encoding="utf-8")
    if marks:
        room.figures.write_bytes(msgspec.json.format(msgspec.json.encode(plain_figures(marks)), indent=1) + b"\n")
    return tables


def _seal_own(args: argparse.Namespace, room: Room) -> int:
    if args.role != "seal" or not (args.world and args.data):
        raise InputError("--world and --data go together, with the role seal")
    print(f"sealed: {seal_own(room, Path(args.world), Path(args.data))}")
    return 0


def _plan(args: argparse.Namespace, room: Room) -> RoundPlan:
    """Return the plan that the round was begun with, or else the plan that the arguments state."""
    begun = load_plan(room) if room.plan.exists() else None
    goes_on = begun is not None and args.seed in (None, begun.seed)
    seed, drawn = (begun.seed, begun.entropy) if begun and goes_on else (_seed(args), args.seed is None)
    return RoundPlan(seed, args.worlds, args.level, args.shots, tuple(args.engines.split(",")), drawn)


def _seed(args: argparse.Namespace) -> int:
    if args.seed is None and not args.seed_from_entropy:
        raise InputError("--seed N, or --seed-from-entropy")
    return entropy() if args.seed is None else int(args.seed)
