"""One question, one answer: the order of rows, the seed, and leaving out every other sample of a track change neither
the names nor the sizes that are found in real recordings.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from truearc.sim.data.dataset import Dataset, Tracks
from truearc.sim.discover.finding import FindingRecord, Named
from truearc.sim.discover.investigate import discover
from truearc_proof.importers.ball_butler import import_ball_butler
from truearc_proof.importers.real_shots import import_ftc_decode, import_fuel_clips
from truearc_proof.importers.set_points import import_254, import_971, import_3476

pytestmark = [pytest.mark.data, pytest.mark.slow]
SETS: dict[str, tuple[Callable[[Path], Dataset], str]] = {
    "a throwing robot": (import_ball_butler, "ball_butler_tracks.csv"),
    "exit speeds": (import_971, "frc971_wheel_to_ball_speed.csv"),
    "set points": (import_254, "frc_shot_tables.csv"),
    "two weeks of set points": (import_3476, "frc3476_tuning_history.csv"),
    "phone clips": (import_fuel_clips, "fuel_clip_shots.csv"),
    "shots at a goal": (import_ftc_decode, "ftc_decode_shots.csv"),
}


def in_order(dataset: Dataset, seed: int) -> Dataset:
    """The same shots in another order."""
    return dataset.take(np.random.default_rng(seed).permutation(len(dataset.shots)).tolist())


def thinned(dataset: Dataset) -> Dataset:
    assert dataset.tracks is not None
    half = np.arange(len(dataset.tracks.shot)) % 2 == 0
    return replace(dataset, tracks=Tracks(*(column[half] for column in vars(dataset.tracks).values())))


def names(finding: FindingRecord) -> frozenset[str]:
    """What it may be; the verdict where that is no term."""
    if finding.verdict in ("named", "set"):
        return frozenset(finding.set or (finding.what[0].term,))
    return frozenset((finding.verdict,))


def apart(one: Named, other: Named) -> list[str]:
    """Numbers of a term that two findings have outside each other's 90 % intervals."""
    return [key for key, here in one.parameters.items() if (there := other.parameters.get(key)) is not None
            and not (there.low90 <= here.value <= there.high90 or here.low90 <= there.value <= here.high90)]


@pytest.mark.parametrize("name", SETS)
def test_one_question_has_one_answer(name: str, data_dir: Path) -> None:
    load, file = SETS[name]
    dataset = load(data_dir / "real" / file)
    first = discover(dataset).finding
    asked = {"another order": (in_order(dataset, 1), 0), "a third order": (in_order(dataset, 2), 0),
             "another seed": (dataset, 1)}
    if dataset.tracks is not None:
        asked["half of the samples"] = (thinned(dataset), 0)
    for what, (other, seed) in asked.items():
        found = discover(other, seed=seed).finding
        assert names(first) & names(found), f"{what}: {sorted(names(found))}, was {sorted(names(first))}"
        sizes = {one.term: one for one in first.what}
        for one in found.what:
            if one.term in sizes and one.term in names(first) & names(found):
                assert not apart(one, sizes[one.term]), f"{what}: {one.term}"
