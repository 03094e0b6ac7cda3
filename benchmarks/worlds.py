"""Concealed worlds of a benchmark: which there are, a file with a line for each, and how findings are marked.

Clean and dirty nulls, one hidden effect each, effects of no catalogue, beliefs cut short.
"""

import argparse
import math
import sys
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from msgspec import Struct

from truearc.cli.common import make_progress
from truearc.errors import InputError
from truearc_proof.rounds.jsonl_store import fill, lines_of
from truearc_proof.scoring.oracle import Measured
from truearc_proof.scoring.score_finding import CUT, NULLS, in_catalogue, names_at
from truearc_proof.scoring.score_world import Mark, mark
from truearc_proof.truth.world import BELIEVED, World, find_effect, make_world
from truearc_proof.worlds.sampling_plan import NUMPY, Drawn

KINDS = {"nulls": "dirty", "effects": "one", "off": "off", "cut": "cut"}      # and what a round of proof calls them
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
    side: bool = False                # the side on which a shot passed is noted

    @property
    def key(self) -> str:
        """The same for the same world."""
        key = f"{self.kind}/{self.name}/{self.level}/{self.shots}/{self.scale:g}/{self.base_seed}/{self.index}"
        return key + ("/side" if self.side else "")

    @property
    def seed(self) -> int:
        """The world's own: different for every base seed, name and index; the same at every level and size."""
        name = zlib.crc32(f"{self.kind}/{self.name}".encode()) % NAMES
        return self.base_seed * SEEDS_A_BASE + name * SEEDS_A_NAME + self.index

def plan_jobs(kinds: Sequence[str], levels: Sequence[str], shots: Sequence[int], worlds: int, base_seed: int,
              scales: dict[str, float], only: Sequence[str] = (), side: bool = False) -> list[Job]:
    """All worlds of a benchmark, those of one shape together.

    scales: per level. only: names to keep (all when empty). InputError for an unknown kind, or a name that no kind has.
    """
    for kind in kinds:
        if kind not in KINDS:
            raise InputError(f"there is no kind of worlds {kind!r}; there are {', '.join(KINDS)}")
    if not 0 < worlds <= SEEDS_A_NAME:
        raise InputError(f"{worlds} worlds of a kind; 1 to {SEEDS_A_NAME} can be had")
    jobs = [Job(kind, name, level, count, 0.0 if kind == "nulls" else scales[level], base_seed, index, side)
            for level in levels for count in shots for index in range(worlds)
            for kind in kinds for name in names_of(kind, level, bool(only)) if not only or name in only]
    missing = set(only) - {job.name for job in jobs}
    if missing:
        raise InputError(f"no world at {', '.join(levels)} is called {', '.join(sorted(missing))}")
    return jobs

def names_of(kind: str, level: str, hopeless: bool = False) -> Iterator[str]:
    """What there is to hide at a level; effects that its data cannot show are left out unless `hopeless`."""
    yield from CUT if kind == "cut" else names_at(kind, level, hopeless)

def amount_of(job: Job) -> float:
    """Amplitude of the hidden effect, its sign by the seed where nature leaves it open; 0 for nulls and cut beliefs."""
    if job.kind in ("nulls", "cut"):
        return 0.0
    effect = find_effect(job.name)
    return effect.typical * job.scale * (-1.0 if effect.signed and job.index % 2 else 1.0)

def world_of(job: Job) -> World:
    """The world itself."""
    dirt = NULLS[job.name] if job.kind == "nulls" else ()
    effects = {job.name: amount_of(job)} if job.kind in ("effects", "off") else {}
    believed = tuple(name for name in BELIEVED if job.kind != "cut" or name != job.name)
    return make_world(effects, job.level, job.shots, job.seed, dirt, believed, job.side)

def drawn_of(job: Job) -> Drawn:
    """The world as a round of proof would state it; a cut term's amplitude is its coefficient."""
    kind = "clean" if job.name == "clean" else KINDS[job.kind]
    world = world_of(job)
    coefficients = {"drag": world.cd, "magnus": world.lift_slope * 3.0 / 32.0,
                    "exit_efficiency": 1.0 - world.efficiency}
    effects = {job.name: coefficients[job.name]} if job.kind == "cut" else dict(world.effects)
    return Drawn(job.key, NUMPY, kind, job.level, job.shots, job.seed, effects, tuple(world.dirt))

def true_parameter(job: Job) -> tuple[str, float] | None:
    """(parameter, value) of the true term in the catalogue's units; None where nothing of the catalogue is hidden."""
    return next((in_catalogue(name, amount) for name, amount in drawn_of(job).effects.items()
                 if not math.isclose(amount, 0.0)), None)

def mark_job(job: Job, finding: dict[str, Any]) -> Mark:
    """Marks of one finding, by the proof's own rules; `ceiling`, `strength` and the oracle's gain are in it."""
    ceiling = finding.get("ceiling")
    return mark(drawn_of(job), finding, measured_of(ceiling, finding))

def measured_of(ceiling: Sequence[Any] | None, finding: dict[str, Any]) -> Measured:
    """What these data allow, as a benchmark's line has it."""
    allowed = None if ceiling is None else tuple(ceiling[:4])
    alike = () if ceiling is None else tuple(ceiling[4])
    fit = finding.get("fit") or {}
    return Measured(allowed, alike, oracle_gain=fit.get("oracle_gain_per_shot"), strength=finding.get("strength"))


def parser_of(text: str | None) -> argparse.ArgumentParser:
    """A parser with where lines are kept and how many worlds run at a time; the benchmark adds its own arguments."""
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--processes", type=int, help="at a time (one a core)")
    place = parser.add_mutually_exclusive_group(required=True)
    place.add_argument("--out", type=Path, metavar="FILE", help="a line a world; what is there is not run again")
    place.add_argument("--table", type=Path, metavar="FILE", help="print what is there (packed or not), run nothing")
    return parser


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
