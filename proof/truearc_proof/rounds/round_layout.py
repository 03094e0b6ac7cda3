"""A round on disk: what is given away, what the keeper keeps, what was claimed, and the ledger of it all.

    ROUND/lock                    held by whoever writes (truearc_proof.rounds.file_lock)
    ROUND/half/                   data in the making; nothing in there is ever read
    ROUND/ledger.jsonl            every step of every world, chained (truearc_proof.rounds.ledger)
    ROUND/data/w0001/             a dataset, given away
    ROUND/data/home/              MuJoCo's robot before anything was changed, where there are such worlds
    ROUND/home.json               what its session leaves to be believed, worked out once for all claims
    ROUND/claims/w0001.json       what the solver says of it, and what more it asks for
    ROUND/more/w0001/             those shots, or measured.json, given away
    ROUND/again/w0001.json        what the solver says once it has them
    ROUND/keeper/round.json       how the round was drawn; not for the solver
    ROUND/keeper/w0001.json       its seal; not for the solver
    ROUND/grades.jsonl            marks of opened worlds
    ROUND/report.html             them all, in pictures and tables
    ROUND/figures.json            the figures of those tables, with intervals
"""

from pathlib import Path
from typing import NamedTuple

from truearc_proof.rounds.ledger import committed, read_ledger

SEALED, CLAIMED, OPENED, GRADED = "sealed", "claimed", "opened", "graded"
ASKED, ANSWERED, CLAIMED_AGAIN = "asked", "answered", "claimed again"


class Room(NamedTuple):
    """Where things are."""

    root: Path

    @property
    def ledger(self) -> Path:
        return self.root / "ledger.jsonl"

    @property
    def keeper(self) -> Path:
        return self.root / "keeper"

    @property
    def plan(self) -> Path:
        return self.keeper / "round.json"

    @property
    def grades(self) -> Path:
        return self.root / "grades.jsonl"

    @property
    def report(self) -> Path:
        return self.root / "report.html"

    @property
    def figures(self) -> Path:
        return self.root / "figures.json"

    @property
    def home(self) -> Path:
        return self.root / "home.json"

    @property
    def half(self) -> Path:
        return self.root / "half"

    def more(self, world: str) -> Path:
        return self.root / "more" / world

    def again(self, world: str) -> Path:
        return self.root / "again" / f"{world}.json"

    def data(self, world: str) -> Path:
        return self.root / "data" / world

    def seal(self, world: str) -> Path:
        return self.keeper / f"{world}.json"

    def claims(self, world: str) -> Path:
        return self.root / "claims" / f"{world}.json"

    def steps(self) -> dict[str, dict[str, str]]:
        """{world: {step: SHA-256}} of every world in the ledger, in its order; InputError where it was changed."""
        entries = read_ledger(self.ledger)
        return {world: committed(entries, world) for world in dict.fromkeys(entry.world for entry in entries)}
