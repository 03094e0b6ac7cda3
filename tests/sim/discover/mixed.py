"""One set of shots of which different things were seen, for tests of everything up to the likelihood.

Forty shots of the concealed truth: FLOWN have a track and no outcome; LANDED an outcome and no track; MEASURED both, a
measured exit and, the first half, a measured height; THROWN a track alone, their launches unknown; the rest both.
"""

from dataclasses import replace

import numpy as np

from truearc.sim.data.dataset import Dataset, Shots, Tracks
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import make_world

SHOTS = 40
FLOWN, LANDED, MEASURED, THROWN = (np.arange(first, first + 8) for first in (0, 8, 16, 24))
BELIEVED = ("gravity", "drag", "magnus", "exit_efficiency")
BALLS = np.arange(SHOTS) % 5


def make_mixed(seed: int = 5) -> Dataset:
    """The shots, with measured exits near what the wheels and the hood said."""
    dataset = shoot(make_world({}, "L2", SHOTS, seed))
    rng = np.random.default_rng(seed)
    assert dataset.tracks is not None
    numbers = {**dataset.shots.numbers, "exit_speed_m_s": np.full(SHOTS, np.nan), "exit_deg": np.full(SHOTS, np.nan),
               "exit_spin_rev_s": np.full(SHOTS, np.nan), "miss_height_m": np.full(SHOTS, np.nan)}
    numbers = {name: column.copy() for name, column in numbers.items()}
    count = len(MEASURED)
    numbers["exit_speed_m_s"][MEASURED] = rng.uniform(7.0, 9.0, count)
    numbers["exit_deg"][MEASURED] = numbers["hood_deg"][MEASURED] + rng.normal(0.0, 0.5, count)
    numbers["exit_spin_rev_s"][MEASURED] = rng.uniform(5.0, 15.0, count)
    numbers["miss_height_m"][MEASURED[:4]] = rng.normal(0.0, 0.1, 4)
    for name in ("hood_deg", "motor_ratio", "wheel_lower_rad_s", "wheel_upper_rad_s"):
        numbers[name][THROWN] = np.nan
    outcome = np.array(dataset.shots.text("outcome"))
    outcome[FLOWN] = outcome[THROWN] = ""
    texts = {**dataset.shots.texts, "outcome": tuple(outcome.tolist())}
    kept = ~np.isin(dataset.tracks.shot, LANDED)
    tracks = Tracks(*(column[kept] for column in vars(dataset.tracks).values()))
    return replace(dataset, shots=Shots(dataset.shots.shot_id, numbers, texts), tracks=tracks)
