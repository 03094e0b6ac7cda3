"""Chance: false alarms as often as was asked for, and scores that lean to no side under the truth."""

import numpy as np
import pytest
from scipy.stats import binom

from truearc.sim.data.dataset import Dataset
from truearc.sim.discover.investigate import detect, make_search
from truearc.sim.discover.select.terms import one_step
from truearc.sim.infer.fit import fit_believed
from truearc.sim.infer.launcher import Launcher, LauncherFit
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import make_world

pytestmark = pytest.mark.slow
WORLDS, SHOTS = 24, 64
TRACKED = range(200, 205)


def believed_fit(dataset: Dataset) -> LauncherFit:
    return fit_believed(Launcher.of(dataset, dataset.facts.believe.terms))


def p_of(seed: int) -> float:
    dataset = shoot(make_world({}, "L0", SHOTS, seed))
    return detect(believed_fit(dataset), make_search(dataset, seed=seed), lambda done, note: None)[1].p_any


def test_false_alarms_come_at_their_rate() -> None:
    found = np.array([p_of(seed) for seed in range(100, 100 + WORLDS)])
    for level in (0.05, 0.2, 0.5):
        low, high = binom.interval(0.999, WORLDS, level)
        assert low <= (found <= level).sum() <= high, (level, np.sort(found))


def test_scores_of_tracks_lean_to_no_side_under_the_truth() -> None:
    """Slopes taken at a track's own deviations go with its noise, and what bends with them would seem to be there."""
    found = []
    for seed in TRACKED:
        fitted = believed_fit(shoot(make_world({}, "L2", 32, seed)))
        found.append({one.name.partition(".")[0]: one.z for one in one_step(fitted.scores)[0]})
    mean = {name: float(np.mean([one[name] for one in found])) for name in found[0]}
    bound = 3.5 / np.sqrt(len(TRACKED))
    for name in ("lift_saturation", "spin_decay", "drag_reynolds", "spin_drag", "wind_x", "wind_z", "added_mass"):
        assert abs(mean[name]) < bound, mean
