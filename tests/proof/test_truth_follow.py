"""Shots that a concealed world is asked for later: the same effects, the same balls, what was asked for."""

from dataclasses import replace

import numpy as np
import pytest

from tests.proof.test_truth_flight import quiet
from truearc.sim.data.dataset import join_datasets
from truearc_proof.truth.generate import Asked, follow, play
from truearc_proof.truth.world import make_world

ASKED = (Asked(3.0, 45.0, 0.5, 12), Asked(5.0, 50.0, 0.62, 8))


def test_the_sensors_have_what_was_asked_for() -> None:
    shots = follow(make_world({"distance_bias": 0.2, "hood_offset": 2.0}, "L1", 40, 5), ASKED).shots
    wanted = [np.repeat([one[k] for one in ASKED], [12, 8]) for k in range(3)]
    assert len(set(shots.shot_id)) == 20
    np.testing.assert_allclose(shots.number("distance_m"), wanted[0], atol=0.15)
    np.testing.assert_allclose(shots.number("hood_deg"), wanted[1], atol=1.0)
    np.testing.assert_array_equal(shots.number("motor_ratio"), wanted[2])


@pytest.mark.parametrize(("effect", "amount"), [("hood_offset", 2.0), ("distance_bias", 0.2), ("wind_x", 3.0)])
def test_the_hidden_effect_is_at_work_as_in_the_season(effect: str, amount: float) -> None:
    """A setting of the season, asked for again in a world without luck or noise, flies as it did there."""
    world, k = quiet(make_world({effect: amount}, "L2", 40, 6)), 7
    season = play(world)
    first = season.dataset.shots
    asked = [Asked(float(first.number("distance_m")[k]), float(first.number("hood_deg")[k]),
                   float(season.motor_ratio[k]), 3)]
    again, plain = follow(world, asked), follow(replace(world, effects={}), asked)
    tops = [dataset.tracks.z_m[dataset.tracks.shot == shot].max()
            for dataset, shot in ((season.dataset, k), (again, 0), (again, 2), (plain, 0))]
    np.testing.assert_allclose(tops[:3], tops[0], atol=0.004)            # 60 frames a second: the very top is missed
    assert effect == "distance_bias" or abs(tops[3] - tops[0]) > 0.02
    assert again.shots.text("outcome") == (first.text("outcome")[k],) * 3
    assert set(again.shots.text("ball_id")) <= set(first.text("ball_id"))
    assert not set(again.shots.text("session")) & set(first.text("session"))


def test_the_same_number_shoots_the_same_shots() -> None:
    world = make_world({"wind_x": 2.0}, "L2", 40, 7)
    one, same, other = follow(world, ASKED), follow(world, ASKED), follow(world, ASKED, 2)
    assert one.shots.numbers["hood_deg"].tobytes() == same.shots.numbers["hood_deg"].tobytes()
    assert one.shots.numbers["hood_deg"].tobytes() != other.shots.numbers["hood_deg"].tobytes()
    assert not set(one.shots.text("session")) & set(other.shots.text("session"))
    with pytest.raises(ValueError, match="no shots"):
        follow(world, [])


def test_both_sessions_as_one_dataset_and_taken_apart_again() -> None:
    world = make_world({}, "L2", 40, 8)
    first, second = play(world).dataset, follow(world, ASKED)
    both = join_datasets(first, second)
    assert len(both.shots) == 60
    back = both.take(range(40, 60))
    assert back.shots.shot_id == second.shots.shot_id
    np.testing.assert_array_equal(back.shots.number("since_last_shot_s"), second.shots.number("since_last_shot_s"))
    for name in ("tracks", "traces"):
        mine, told = getattr(back, name), getattr(second, name)
        for column in vars(told):
            np.testing.assert_array_equal(getattr(mine, column), getattr(told, column))
    with pytest.raises(ValueError, match="in common"):
        join_datasets(first, first)
