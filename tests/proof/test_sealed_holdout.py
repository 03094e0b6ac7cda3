"""Shots that nobody gets: who believes the truth foretells them as well as luck lets anybody, who does not, worse."""

import numpy as np
import pytest

from truearc.sim.infer.belief import Belief, point_belief
from truearc_proof.scoring.sealed_holdout import off_m, shoot_unseen
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import make_world
from truearc_proof.worlds.sampling_plan import Drawn


def drawn(effects: dict[str, float], engine: str = "numpy") -> Drawn:
    return Drawn("w1", engine, "one", "L0", 200, 41, effects)


def truth(one: Drawn, more: dict[str, dict[str, float]]) -> Belief:
    """The world's own coefficients in the catalogue's words (truearc_proof.scoring.score_finding)."""
    world = make_world(one.effects, one.level, one.shots, one.seed)
    return point_belief({"drag": {"cd": world.cd}, "magnus": {"cl": world.lift_slope * 3.0 / 32.0},
                         "exit_efficiency": {"loss": 1.0 - world.efficiency}} | more)


@pytest.mark.parametrize(("name", "amount", "term"), [
    ("target_height", 0.3, {"rise_m": 0.3}), ("release_height", 0.3, {"above_m": 0.3}),
    ("distance_bias", 0.4, {"bias_m": 0.4}), ("wind_x", 3.0, {"speed_m_s": 3.0})])
def test_the_true_term_is_off_by_luck_alone(name: str, amount: float, term: dict[str, float]) -> None:
    one, null = drawn({name: amount}), drawn({})
    unseen, luck = shoot_unseen(one), shoot_unseen(null)
    assert unseen is not None and luck is not None
    best = off_m(truth(null, {}), luck)
    assert 0.7 * best < off_m(truth(one, {name: term}), unseen) < 1.15 * best
    assert off_m(truth(one, {}), unseen) > 1.3 * best


def test_they_are_none_of_the_world_s_own_and_the_same_every_time() -> None:
    one = drawn({"wind_x": 2.0})
    first, again = shoot_unseen(one), shoot_unseen(one)
    own = shoot(make_world(one.effects, one.level, one.shots, one.seed))
    assert first is not None and again is not None and len(first.dataset.shots) == len(own.shots)
    np.testing.assert_array_equal(first.above_m, again.above_m)
    assert not set(first.dataset.shots.number("distance_m")) & set(own.shots.number("distance_m"))


def test_a_ball_that_is_said_to_fall_short_comes_in_at_the_floor() -> None:
    unseen = shoot_unseen(drawn({}))
    assert unseen is not None
    heavy = truth(drawn({}), {"drag": {"cd": 50.0}})
    centre_m = 2.44
    floor = float(np.sqrt(np.nanmean((unseen.above_m + centre_m)**2)))
    assert off_m(heavy, unseen) == pytest.approx(floor, rel=1e-9)


def test_nobody_else_can_shoot_somebody_else_s_world() -> None:
    assert shoot_unseen(drawn({"wind_x": 2.0}, "own")) is None


@pytest.mark.slow
def test_mujoco_s_robot_is_shot_again_with_what_is_hidden_in_it() -> None:
    """A launcher that stands higher than stated throws as much higher."""
    one = Drawn("w1", "mujoco", "one", "L0", 40, 900, {"release_height_error_m": 0.4}, change="release_height")
    unseen = shoot_unseen(one)
    assert unseen is not None and 30 <= np.isfinite(unseen.above_m).sum() <= 40
    low = shoot_unseen(Drawn("w1", "mujoco", "clean", "L0", 40, 900, change="nothing"))
    assert low is not None
    assert np.nanmean(unseen.above_m) - np.nanmean(low.above_m) == pytest.approx(0.4, abs=0.1)
