"""The collection ends with what a draw needs, goes on where it was broken off, and launches what it says it does."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from tests.proof.reproduce.pools import CONFIG, FACTS, SMALL, Launcher
from truearc.errors import InputError
from truearc.sim.paper.synthetic import AXES
from truearc_proof.reproduce.collect import LAUNCHABLE, collect, collect_real

pytestmark = pytest.mark.slow
SETTINGS = replace(SMALL, practice_trials=75, session_rows=12, most_rounds=6, launched=24)
NO_PROGRESS = staticmethod(lambda done, note: None).__func__


@pytest.fixture(scope="module")
def collected(tmp_path_factory):
    launcher = Launcher(tmp_path_factory.mktemp("collect"))
    return launcher, collect(CONFIG, SETTINGS, launcher, NO_PROGRESS)


def test_every_outcome_is_there_as_often_as_asked_with_its_repeats(collected):
    _, pool = collected
    outcomes = pool.real.shots.text("outcome")
    assert min(outcomes.count(kind) for kind in ("miss", "two", "three")) >= SETTINGS.pool_each
    assert (pool.real.shots.number("repeats") == SETTINGS.repeats).all()
    assert pool.real.facts == FACTS


def test_what_was_launched_is_on_the_seeds_grid_within_reach_and_knows_what_was_simulated(collected):
    _, pool = collected
    shots = pool.launched.shots
    assert 0 < len(shots) <= SETTINGS.launched
    for axis in AXES:
        values = shots.number(axis.name)
        low, high = LAUNCHABLE[axis.name]
        assert (values >= low - 1e-9).all() and (values <= high + 1e-9).all()
        assert np.allclose(values * axis.per_unit, np.rint(values * axis.per_unit), atol=1e-6)
    assert set(shots.text("simulated")) == {"miss", "two", "three"}


def test_what_the_simulator_said_is_of_the_very_configuration(collected):
    from truearc.sim.physics.simulate import classify, predict
    _, pool = collected
    said = classify(FACTS, predict(FACTS, pool.coefficients, pool.launched.shots).height_m)
    assert tuple(said) == pool.launched.shots.text("simulated")


def test_a_broken_off_collection_goes_on_and_comes_to_the_same(collected, tmp_path):
    launcher, pool = collected
    again = Launcher(tmp_path)
    kept = [name for name in launcher.made if not name.startswith("launched")][:-1]
    for name in kept:
        shutil.copytree(launcher.folder / name, tmp_path / name)
    repeated = collect(CONFIG, SETTINGS, again, NO_PROGRESS)
    assert again.asked == launcher.asked and set(again.made) == set(launcher.made) - set(kept)
    assert repeated.real.shots.shot_id == pool.real.shots.shot_id
    assert np.array_equal(repeated.launched.shots.number("motor_ratio"), pool.launched.shots.number("motor_ratio"))


def test_too_little_is_told_with_what_there_is(tmp_path):
    few = replace(SETTINGS, most_rounds=1, session_rows=3)
    with pytest.raises(InputError, match=r"4 sessions gave \d+ miss, \d+ two, \d+ three: too few"):
        collect_real(CONFIG, few, Launcher(tmp_path))


def test_every_session_has_a_seed_of_its_own(collected):
    launcher, _ = collected
    assert any(name.startswith("launched") for name in launcher.made)
    assert len(set(launcher.seeds)) == len(launcher.seeds) > 4
