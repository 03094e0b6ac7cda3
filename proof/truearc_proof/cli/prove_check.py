"""Check of a packed round by a third party: its data and marks are made again, and the solver repeats its claims."""

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path

from truearc.cli.common import make_progress
from truearc.errors import InputError
from truearc_proof.cli.prove_apart import solve_apart
from truearc_proof.rounds.archive import check_round, unpack
from truearc_proof.rounds.reproduce_claims import compare_claims, give_away, solver_of
from truearc_proof.rounds.round_layout import Room
from truearc_proof.rounds.solver import solver_id


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
