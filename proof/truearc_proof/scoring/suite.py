"""What may be hidden in a concealed world at a level of data, and the dirt that worlds with nothing hidden have."""

from collections.abc import Iterator

from truearc_proof.truth.effects import ABSORBED, CATALOGUED, COVARIATE_EFFECTS, TRACK_EFFECTS, UNCATALOGUED
from truearc_proof.truth.world import TRACK_DIRT

NULLS: dict[str, tuple[str, ...]] = {
    "clean": (), "balls": ("balls",), "outliers": ("outliers",), "noise_understated": ("noise_understated",),
    "noise_overstated": ("noise_overstated",), "track_memory": ("track_memory",), "missing_frames": ("missing_frames",),
    "clipped": ("clipped",),
    "all": ("balls", "outliers", "noise_understated", "track_memory", "missing_frames", "clipped")}


def names_at(kind: str, level: str, hopeless: bool = False) -> Iterator[str]:
    """Names of "nulls", "effects" of the catalogue, or effects "off" it at a level; effects that its data cannot show
    are left out unless `hopeless`."""
    if kind == "nulls":
        yield from (name for name, dirt in NULLS.items()
                    if level == "L2" or name == "all" or not any(one in TRACK_DIRT for one in dirt))
    else:
        effects = CATALOGUED if kind == "effects" else UNCATALOGUED
        yield from (effect.name for effect in effects if hopeless or effect.name not in unseen(level))


def unseen(level: str) -> tuple[str, ...]:
    """Effects of which the data of a level have no trace, by what they are."""
    return ABSORBED + {"L0": COVARIATE_EFFECTS + TRACK_EFFECTS, "L1": TRACK_EFFECTS, "L2": ()}[level]
