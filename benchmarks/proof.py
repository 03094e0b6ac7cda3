"""The tables of packed rounds of proof, as they appear in docs/measured/proof.md.

    truearc prove pack --out ROUND --packed round.tar.xz
    python -m benchmarks.proof round.tar.xz [--reliability FILE.png]

Rounds with the same level and number of shots are evaluated as one round. Only the ledger's hash chain is verified
here; `truearc prove check --packed FILE --out DIR` recreates worlds.
"""

import tempfile
from collections.abc import Sequence
from itertools import groupby, pairwise
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
from matplotlib.axes import Axes

from benchmarks.options import read_options
from truearc.sim.report import make_png, new_figure
from truearc.sim.statistics import wilson
from truearc_proof.rounds import Room, last_digest, read_ledger
from truearc_proof.rounds.archive import unpack
from truearc_proof.rounds.committer import load_plan
from truearc_proof.rounds.grader import Graded, graded_of
from truearc_proof.rounds.marks import Mark
from truearc_proof.rounds.tables import posterior_rows
from truearc_proof.table import make_markdown

INK, OURS, UNEXPLAINED = "#30343b", "#1f5fa8", "#c2571a"
CLAIMED = (0.0, 0.2, 0.4, 0.6, 0.8, 0.95, 1.01)       # bins of probabilities


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


def reliability_png(marks: Sequence[Mark]) -> bytes | None:
    """Draw claimed probabilities against how often they were right, one panel per level; None if none is known.

    Of the first name in worlds with something hidden, where the verdict is not unknown: right, or of its class; of an
    unexplained change: nothing hidden is in the catalogue.
    """
    levels = sorted({one.level for one in marks if one.said is not None})
    if not levels:
        return None
    figure = new_figure(0.6 + 3.4 * len(levels), 3.8)
    for axes, level in zip(figure.subplots(1, len(levels), squeeze=False)[0], levels, strict=True):
        mine = [one for one in marks if one.level == level and one.said is not None]
        claims = [(float(one.said or 0.0), bool(one.alias)) for one in mine if one.verdict != "unknown"]
        odd = [(float(one.unexplained), not one.right) for one in mine if one.unexplained is not None]
        axes.plot([0, 1], [0, 1], "--", color=INK, lw=0.8)
        for pairs, colour, label in ((claims, OURS, "first name"), (odd, UNEXPLAINED, "unexplained")):
            _draw_claims(axes, pairs, colour, f"{label}: {len(pairs)} worlds")
        axes.set(xlim=(-0.03, 1.03), ylim=(-0.03, 1.03), title=level, xlabel="probability that was claimed")
        axes.legend(frameon=False, loc="upper left", fontsize=8)
        axes.spines[["top", "right"]].set_visible(False)
    figure.axes[0].set_ylabel("share that was right, 95 %")
    return make_png(figure)


def _draw_claims(axes: Axes, pairs: Sequence[tuple[float, bool]], colour: str, label: str) -> None:
    """Points at the mean claim of each bin."""
    bins = claimed_bins(pairs)
    said, right = [mean for mean, _, _ in bins], np.array([hits / of for _, hits, of in bins])
    ends = np.array([wilson(hits, of) for _, hits, of in bins]).reshape(-1, 2)
    axes.errorbar(said, right, np.abs(ends.T - right), fmt="o", color=colour, ms=5, capsize=2.5, label=label)


def claimed_bins(pairs: Sequence[tuple[float, bool]]) -> list[tuple[float, int, int]]:
    """Return (mean claimed probability, how many were right, of how many) of each non-empty bin of CLAIMED."""
    bins = [[pair for pair in pairs if low <= pair[0] < high] for low, high in pairwise(CLAIMED)]
    return [(float(np.mean([said for said, _ in each])), sum(hit for _, hit in each), len(each)) for each in bins
            if each]


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
    table = make_markdown(("figure", "result", "target", ""), posterior_rows(marks))
    return f"## {level}, {shots} shots, {len(marks)} worlds\n{table}\n\n{facts}\n"


if __name__ == "__main__":
    main()
