"""The tables of packed rounds of proof, as docs/measured/proof.md has them.

    truearc prove pack --out ROUND --packed round.tar.xz
    python -m benchmarks.proof round.tar.xz [--reliability FILE.png]

Rounds of one level and as many shots, gathered over several sittings, are marked as one.
Nothing is checked here but the ledger's chain: `truearc prove check --packed FILE --out DIR` makes worlds again.
"""

import tempfile
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

import msgspec

from benchmarks.options import read_options
from truearc_proof.rounds import Room, last_digest, read_ledger
from truearc_proof.rounds.archive import unpack
from truearc_proof.rounds.committer import load_plan
from truearc_proof.rounds.grader import Graded, graded_of
from truearc_proof.rounds.page import reliability_png
from truearc_proof.rounds.tables import posterior_rows
from truearc_proof.table import make_markdown


def main() -> None:
    args = read_options(__doc__, packed=([...], "rounds"),
                        reliability=(Path, "picture (PNG): probabilities beside what was right"))
    rounds = sorted(map(load, args.packed), key=lambda one: one.setting)
    if args.reliability is not None:
        drawn = reliability_png([one.first for packed in rounds for one in packed.graded])
        if drawn is None:
            raise SystemExit("these rounds were marked without the probabilities that were claimed")
        args.reliability.write_bytes(drawn)
    print(tell_posteriors(rounds))


class Packed(NamedTuple):
    """A packed round. facts: its seeds and its solver, as text."""

    setting: tuple[str, int]
    graded: tuple[Graded, ...]
    facts: str


def load(path: Path) -> Packed:
    with tempfile.TemporaryDirectory() as folder:
        room = Room(Path(folder) / "round")
        unpack(path, room)
        plan, graded, entries = load_plan(room), tuple(graded_of(room)), read_ledger(room.ledger)
        solvers = sorted({msgspec.json.decode(room.claims(one.world).read_bytes())["solver"] for one in graded})
        last = last_digest(room.ledger)
    facts = (f"{plan.worlds} worlds drawn from {plan.seed} ({', '.join(plan.engines)}). Solver (SHA-256 of its code): "
             f"{', '.join(f'`{one[:16]}`' for one in solvers)}. Ledger: {len(entries)} lines, SHA-256 of the last "
             f"`{last[:16]}`. File: `{path.name}`.")
    return Packed((plan.level, plan.shots), graded, facts)


def tell_posteriors(rounds: Sequence[Packed]) -> str:
    """Of rounds in the order of their settings, all levels."""
    return "\n".join(_tell_level(list(group)) for _, group in groupby(rounds, key=lambda one: one.setting))


def _tell_level(rounds: Sequence[Packed]) -> str:
    """Of rounds of one level what each was drawn from, and their figures beside the targets of the posterior."""
    level, shots = rounds[0].setting
    marks = [one.first for packed in rounds for one in packed.graded]
    facts = "\n".join(f"- {packed.facts}" for packed in rounds)
    table = make_markdown(("figure", "here", "wanted", ""), posterior_rows(marks))
    return f"## {level}, {shots} shots, {len(marks)} worlds\n{table}\n\n{facts}\n"


if __name__ == "__main__":
    main()
