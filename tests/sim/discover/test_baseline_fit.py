"""The fit of what is believed: at its top, and at the highest of several."""

from dataclasses import replace

import numpy as np
import pytest

from truearc.sim.infer.fit import climb, fit_believed, newton_step
from truearc.sim.infer.launcher import Launcher, LauncherFit
from truearc.sim.physics.catalogue import find_parameter
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import World, make_world

pytestmark = pytest.mark.slow
SHOTS = 100


def fit_world(world: World, slow: float = 1.0) -> LauncherFit:
    """`slow`: by how much longer all flights seem to take."""
    dataset = shoot(world)
    if dataset.tracks is not None:
        dataset = replace(dataset, tracks=replace(dataset.tracks, t_s=slow * dataset.tracks.t_s))
    return fit_believed(Launcher.of(dataset, dataset.facts.believe.terms))


@pytest.mark.parametrize("seed", [6, 16])
def test_no_climb_from_the_truth_or_the_priors_middle_ends_a_nat_higher(seed: int) -> None:
    """Sixteen balls with effects of their own and 100 outcomes: a likelihood of several tops."""
    world = make_world({"battery_sag": 0.5}, "L1", SHOTS, seed)
    fitted = fit_world(world)
    bare, middle = fitted.model.shared_only(), fitted.model.middle()
    true = middle.values.copy()
    for name, value in (("drag", world.cd), ("magnus", world.lift_slope * 3.0 / 32.0),
                        ("exit_efficiency", 1.0 - world.efficiency)):
        true[next(k for k, slot in enumerate(fitted.model.layout.chain.slots) if slot[0] == name)] = value
    for values in (true, middle.values):
        for factor in (1.0, 4.0):
            start = type(middle)(values, middle.log_scatter + np.log(factor), middle.deviates, middle.effects)
            assert fitted.without_terms().log_posterior >= climb(bare, start).log_posterior - 1.0


def test_at_the_top_no_step_promises_anything() -> None:
    fitted = fit_world(make_world({}, "L1", SHOTS, 18))
    assert newton_step(fitted.scores.shared_only())[1] < 0.01


def test_where_one_number_comes_to_its_limit_the_others_still_climb_to_their_best() -> None:
    """A clock that is wrong by more than is believed of any: it stays at its limit, and no step of all else promises
    anything there."""
    fitted = fit_world(make_world({}, "L2", 24, 3), 0.9)
    evidence = fitted.scores.shared_only()
    clock = np.array([column.name == "track_clock.share" for column in evidence.columns])
    assert fitted.values["track_clock.share"] == find_parameter("track_clock.share").high
    assert newton_step(evidence)[1] > 10.0 and newton_step(evidence, ~clock)[1] < 1.0
