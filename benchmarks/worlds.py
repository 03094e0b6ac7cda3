"""The concealed worlds of a benchmark: their selection, a file with one line per world, and the grading of findings.

The worlds are clean and dirty nulls, worlds with one hidden effect, and worlds with an effect outside the catalogue.
"""

import argparse
import sys
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from msgspec import Struct

from benchmarks.options import add_options
from truearc.cli.common import make_progress
from truearc.errors import InputError
from truearc_proof.parallel import fill, lines_of
from truearc_proof.rounds.marks import Mark, Measured, mark
from truearc_proof.rounds.worlds import DIRTS, NUMPY, Drawn, names_at
from truearc_proof.truth.world import World, find_effect, make_world

KINDS = {"nulls": "dirty", "effects": "one", "off": "off"}      # and what a round of proof calls them
SEEDS_A_BASE, SEEDS_A_NAME = 100_000_000, 10_000
NAMES = SEEDS_A_BASE // SEEDS_A_NAME
Line = dict[str, Any]
One = TypeVar("One")


class Job(Struct, frozen=True):
    """One world to be discovered in. `scale`: of the effect's typical amplitude; `index`: which of its kind."""

    kind: str
    name: str
    level: str
    shots: int
    scale: float
    base_seed: int
    index: int

    @property
    def key(self) -> str:
        """The same for the same world."""
        return f"{self.kind}/{self.name}/{self.level}/{self.shots}/{self.scale:g}/{self.base_seed}/{self.index}"

    @property
    def seed(self) -> int:
        """The world's own: different for every base seed, name and index; the same at every level and size."""
        name = zlib.crc32(f"{self.kind}/{self.name}".encode()) % NAMES
        return self.base_seed * SEEDS_A_BASE + name * SEEDS_A_NAME + self.index


def plan_jobs(kinds: Sequence[str], levels: Sequence[str], shots: Sequence[int], worlds: int, base_seed: int,
              scales: dict[str, float], only: Sequence[str] = ()) -> list[Job]:
    """All worlds of a benchmark, those of one shape together.

    scales: per level. only: names to keep (all when empty). InputError for an unknown kind, or a name that no kind has.
    """
    for kind in kinds:
        if kind not in KINDS:
            raise InputError(f"there is no kind of worlds {kind!r}; there are {', '.join(KINDS)}")
    if not 0 < worlds <= SEEDS_A_NAME:
        raise InputError(f"{worlds} worlds of a kind; 1 to {SEEDS_A_NAME} can be had")
    jobs = [Job(kind, name, level, count, 0.0 if kind == "nulls" else scales[level], base_seed, index)
            for level in levels for count in shots for index in range(worlds)
            for kind in kinds for name in names_at(kind, level, bool(only)) if not only or name in only]
    missing = set(only) - {job.name for job in jobs}
    if missing:
        raise InputError(f"no world at {', '.join(levels)} is called {', '.join(sorted(missing))}")
    return jobs


def amount_of(job: Job) -> float:
    """Amplitude of the hidden effect, its sign by the seed where nature leaves it open."""
    effect = find_effect(job.name)
    return effect.typical * job.scale * (-1.0 if effect.signed and job.index % 2 else 1.0)


def world_of(job: Job) -> World:
    """The world itself."""
    effects, dirt = ({}, DIRTS[job.name]) if job.kind == "nulls" else ({job.name: amount_of(job)}, ())
    return make_world(effects, job.level, job.shots, job.seed, dirt)


def mark_job(job: Job, finding: dict[str, Any]) -> Mark:
    """Marks of one finding, by the proof's own rules."""
    kind, world = "clean" if job.name == "clean" else KINDS[job.kind], world_of(job)
    drawn = Drawn(job.key, NUMPY, kind, job.level, job.shots, job.seed, dict(world.effects), tuple(world.dirt))
    return mark(drawn, finding, Measured())


def read_args(text: str | None, **options: Any) -> argparse.Namespace:
    """Where lines are kept, how many worlds run at a time, and the benchmark's own options."""
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    place = parser.add_mutually_exclusive_group(required=True)
    place.add_argument("--out", type=Path, metavar="FILE", help="a line a world; what is there is not run again")
    place.add_argument("--table", type=Path, metavar="FILE", help="print what is there (packed or not), run nothing")
    return add_options(parser, processes=(int, "at a time (one a core)"), **options).parse_args()


def fill_and_tell(args: argparse.Namespace, plan: Callable[[], Mapping[str, One]], run: Callable[[One], Line],
                  make_table: Callable[[Sequence[Line]], str]) -> int:
    """Run the planned jobs whose keys the file lacks, print the table of all its lines; exit code."""
    try:
        path = args.table or args.out
        lines = ({line["key"]: line for line in lines_of(path)} if args.table is not None else
                 fill(path, plan(), run, make_progress("worlds"), args.processes))
        if not lines:
            raise InputError(f"{path}: no world is in it")
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    print(make_table(list(lines.values())))
    return 0
