"""Which concealed worlds a benchmark is made of: clean and dirty nulls, one hidden effect each, beliefs cut short."""

import zlib
from collections.abc import Iterator, Sequence

from msgspec import Struct

from robot.config import BadInput
from sim.prove.truth.effects import (
    ABSORBED,
    CATALOGUED,
    COVARIATE_EFFECTS,
    TRACK_EFFECTS,
    UNCATALOGUED,
    find_effect,
)
from sim.prove.truth.world import BELIEVED, TRACK_DIRT, World, make_world

KINDS = ("nulls", "effects", "off", "cut")
NULLS: dict[str, tuple[str, ...]] = {
    "clean": (), "balls": ("balls",), "outliers": ("outliers",), "noise_understated": ("noise_understated",),
    "noise_overstated": ("noise_overstated",), "track_memory": ("track_memory",), "missing_frames": ("missing_frames",),
    "clipped": ("clipped",),
    "all": ("balls", "outliers", "noise_understated", "track_memory", "missing_frames", "clipped")}
CUT = ("drag", "magnus", "exit_efficiency")          # true, but not believed
SEEDS_A_BASE, SEEDS_A_NAME = 100_000_000, 10_000
NAMES = SEEDS_A_BASE // SEEDS_A_NAME


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

    scales: per level. only: names to keep (all when empty). BadInput for an unknown kind, or a name that no kind has.
    """
    for kind in kinds:
        if kind not in KINDS:
            raise BadInput(f"there is no kind of worlds {kind!r}; there are {', '.join(KINDS)}")
    if not 0 < worlds <= SEEDS_A_NAME:
        raise BadInput(f"{worlds} worlds of a kind; 1 to {SEEDS_A_NAME} can be had")
    jobs = [Job(kind, name, level, count, 0.0 if kind == "nulls" else scales[level], base_seed, index, side)
            for level in levels for count in shots for index in range(worlds)
            for kind in kinds for name in names_of(kind, level, bool(only)) if not only or name in only]
    missing = set(only) - {job.name for job in jobs}
    if missing:
        raise BadInput(f"no world at {', '.join(levels)} is called {', '.join(sorted(missing))}")
    return jobs


def names_of(kind: str, level: str, hopeless: bool = False) -> Iterator[str]:
    """What there is to hide at a level; effects that its data cannot show are left out unless `hopeless`."""
    if kind == "nulls":
        yield from (name for name, dirt in NULLS.items()
                    if level == "L2" or name == "all" or not any(one in TRACK_DIRT for one in dirt))
    elif kind == "cut":
        yield from CUT
    else:
        effects = CATALOGUED if kind == "effects" else UNCATALOGUED
        yield from (effect.name for effect in effects if hopeless or effect.name not in unseen(level))


def unseen(level: str) -> tuple[str, ...]:
    """Effects of which the data of a level have no trace, by what they are."""
    return ABSORBED + {"L0": COVARIATE_EFFECTS + TRACK_EFFECTS, "L1": TRACK_EFFECTS, "L2": ()}[level]


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
