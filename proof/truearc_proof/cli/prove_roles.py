"""Implementation of the roles of `truearc prove`."""

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import msgspec

from truearc.cli.common import make_progress
from truearc.errors import InputError
from truearc.sim.compute import keep_compiled
from truearc.sim.infer.likelihood.data import FEWEST_SHOTS
from truearc_proof.rivals import find_rival
from truearc_proof.rounds import Room, Step, last_digest, read_ledger
from truearc_proof.rounds.archive import check_round, compare_claims, give_away, pack, solver_of, unpack
from truearc_proof.rounds.committer import RoundPlan, entropy, load_plan, seal_own, seal_round
from truearc_proof.rounds.grader import Graded, grade_round, graded_of, unclaimed
from truearc_proof.rounds.solver import solve_round, solver_id
from truearc_proof.rounds.tables import make_tables, plain_figures, verdict
from truearc_proof.rounds.worlds import OWN


def solve_apart(args: argparse.Namespace, out: str) -> None:
    """Run the solver in a process of its own."""
    more = ["--processes", str(args.processes)] if args.processes else []
    more += ["--quiet"] if args.quiet else []
    more += ["--rivals", args.rivals] if args.rivals and args.role is None else []
    done = subprocess.run([sys.executable, "-m", "truearc", "prove", "solve", "--out", out, *more], check=False)
    if done.returncode:
        raise InputError(f"the solver ended with exit code {done.returncode}")


def check_packed(args: argparse.Namespace, room: Room) -> None:
    """Recreate the data and marks of a round and print the comparison.

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
    return f"{', '.join(names)}: solved again from the data alone, and marked alike."


def play_role(args: argparse.Namespace) -> int:
    """Play one role or all; args: those of `truearc prove`, defaults filled in."""
    room = Room(Path(args.out))
    _check(args)
    keep_compiled()
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
        seal_round(room, _plan(args, room), make_progress("seal", args.quiet), args.processes)
    if args.role == "solve":
        solve_round(room, make_progress("solve", args.quiet), args.processes, _rivals(args))
    elif args.role is None:
        solve_apart(args, args.out)
    if args.role in (None, "grade"):
        _tell(args, room, grade_round(room, make_progress("grade", args.quiet), args.processes, args.so_far))
    # to be told to the others, so that nothing in the ledger can be changed unseen from here on
    print(f"{room.ledger}: {len(read_ledger(room.ledger))} lines, SHA-256 of the last: {last_digest(room.ledger)}")
    return 0


def _pack(args: argparse.Namespace, room: Room) -> int:
    if not args.packed:
        raise InputError("pack: --packed FILE is needed")
    pack(room, Path(args.packed))
    print(f"{args.packed}: {len(room.steps())} worlds, {Path(args.packed).stat().st_size >> 10} KiB")
    return 0


def _check(args: argparse.Namespace) -> None:
    """InputError for numbers that no round can have, rivals that there are none of or that have nothing to be put to,
    and a round that is not there."""
    for name, least in (("seed", 0), ("worlds", 1), ("shots", FEWEST_SHOTS), ("processes", 1), ("solve", 0)):
        value = getattr(args, name)
        if value is not None and value < least:
            raise InputError(f"--{name} {value}: {least} or more")
    for name in _rivals(args):
        find_rival(name)
    if args.rivals and args.role in (None, "seal") and args.level != "L2":
        raise InputError(f"--rivals: others are put to tracks alone, which --level {args.level} does not have; L2 does")
    if args.solve and (args.role != "check" or args.solve > args.worlds):
        raise InputError(f"--solve {args.solve}: with check, and no more than --worlds {args.worlds}, which are made "
                       "again")
    ledger, unpacked = Room(Path(args.out)).ledger, args.role == "check" and args.packed
    if args.role in ("solve", "grade", "pack", "check") and not (unpacked or ledger.exists()):
        raise InputError(f"{ledger}: is missing: no round was begun there")


def _rivals(args: argparse.Namespace) -> tuple[str, ...]:
    return tuple(args.rivals.split(",")) if args.rivals else ()


def _tell(args: argparse.Namespace, room: Room, graded: Sequence[Graded]) -> None:
    """Print the tables; write their figures."""
    steps = room.steps()
    if waiting := len(unclaimed(steps)):
        print(f"{waiting} worlds are sealed and not claimed: they are in no table.")
    if not graded:
        print("Nothing has been marked yet.")
        return
    marks = [one.first for one in graded]
    room.figures.write_bytes(msgspec.json.format(msgspec.json.encode(plain_figures(marks)), indent=1) + b"\n")
    sealed = [f"{one.world} was sealed as {steps[one.world][Step.SEALED]}: compare it with the number you were given"
              for one in graded if one.first.engine == OWN]
    print("\n\n".join([verdict(marks), *(one.markdown() for one in make_tables(marks)), *sealed,
                       f"figures: {room.figures}; every mark: {room.grades}"]))


def _seal_own(args: argparse.Namespace, room: Room) -> int:
    if args.role != "seal" or not (args.world and args.data):
        raise InputError("--world and --data go together, with the role seal")
    print(f"sealed: {seal_own(room, Path(args.world), Path(args.data))}")
    return 0


def _plan(args: argparse.Namespace, room: Room) -> RoundPlan:
    """Return the plan that the round was begun with, or else the plan that the arguments state."""
    begun = load_plan(room) if room.plan.exists() else None
    if begun is not None and args.seed in (None, begun.seed):
        seed, drawn = begun.seed, begun.entropy
    elif args.seed is None and not args.seed_from_entropy:
        raise InputError("--seed N, or --seed-from-entropy")
    else:
        seed, drawn = entropy() if args.seed is None else args.seed, args.seed is None
    return RoundPlan(seed, args.worlds, args.level, args.shots, tuple(args.engines.split(",")), drawn)
