"""False alarms: as often as was asked for, on worlds without a mismatch, clean and dirty."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import binom

from sim.discover.discover import discover
from sim.shots import Dataset
from tests.sim.discover.worlds import World, make_outcomes, make_tracks

pytestmark = pytest.mark.slow
WORLDS = 100


def p_values(make: Callable[[int], Dataset], believed: tuple[str, ...] | None) -> np.ndarray:
    found = [discover(make(seed), believed, seed=seed).finding.mismatch.p_value for seed in range(1000, 1000 + WORLDS)]
    return np.array([p for p in found if p is not None])


@pytest.mark.parametrize(("name", "make", "believed"), [
    ("tracks", lambda seed: make_tracks(World(), 24, seed), ("gravity", "drag")),
    ("tracks, noise with a memory", lambda seed: make_tracks(World(track_memory=0.8), 24, seed), ("gravity", "drag")),
    ("outcomes", lambda seed: make_outcomes(World(), 40, seed), None),
])
def test_false_alarms_come_at_their_rate(name: str, make: Callable[[int], Dataset],
                                         believed: tuple[str, ...] | None) -> None:
    p = p_values(make, believed)
    assert len(p) == WORLDS
    for level in (0.05, 0.2, 0.5):
        low, high = binom.interval(0.995, WORLDS, level)
        assert low <= (p <= level).sum() <= high, (name, level)
