"""A round's worlds: the shares, the ladder, and that each can be made as drawn."""

from collections import Counter
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from truearc.errors import InputError
from truearc.sim.data.files import load_dataset
from truearc_proof.rounds.worlds import (
    LADDER,
    LARGEST,
    MUJOCO,
    NUMPY,
    SHARES,
    Drawn,
    change_robot,
    draw_round,
    make_data,
    make_more,
)
from truearc_proof.truth.generate import Asked, shoot
from truearc_proof.truth.world import UNCATALOGUED, find_effect, make_world

LEVELS = ("L0", "L1", "L2")
OFF = {effect.name for effect in UNCATALOGUED}


def drawn(level: str, worlds: int = 400, engines: tuple[str, ...] = (NUMPY, MUJOCO)) -> tuple[Drawn, ...]:
    return draw_round(11, worlds, level, 300, engines)


@pytest.mark.parametrize("level", LEVELS)
def test_kinds_come_in_their_shares_and_in_no_order(level: str) -> None:
    kinds = [one.kind for one in drawn(level)]
    assert Counter(kinds) == {kind: round(share * 400) for kind, share in SHARES.items()}
    changes = sum(a != b for a, b in pairwise(kinds))
    assert changes > 250                              # sorted they would change six times


def test_a_small_round_has_as_many_worlds_as_it_was_asked_for() -> None:
    for worlds in range(1, 30):
        round_ = drawn("L1", worlds)
        assert [one.name for one in round_] == [f"w{number:04d}" for number in range(1, worlds + 1)]
        assert len({one.seed for one in round_}) == worlds


def test_one_number_draws_one_round() -> None:
    assert drawn("L1") == drawn("L1") != draw_round(12, 400, "L1", 300)


@pytest.mark.parametrize("level", LEVELS)
def test_sizes_are_on_the_ladder_or_as_large_as_is_credible(level: str) -> None:
    for one in drawn(level):
        for name, size in one.strength.items():
            factor = abs(one.effects[name]) / abs(find_effect(name).typical)
            assert factor <= LARGEST + 1e-12
            assert min(abs(size / step - 1.0) for step in LADDER) < 1e-9 or factor in (1.0, 2.0, 2.5, 3.0, LARGEST)


def test_more_shots_show_smaller_effects() -> None:
    few, many = (np.median([abs(one.effects[name] / find_effect(name).typical)
                            for one in draw_round(5, 300, "L1", shots) for name in one.strength])
                 for shots in (100, 1000))
    assert many < 0.7 * few


@pytest.mark.parametrize("level", LEVELS)
def test_what_is_hidden_is_of_its_kind(level: str) -> None:
    for one in drawn(level):
        if one.engine == MUJOCO:
            continue                                  # tests.sim.prove.test_mujoco_kinds
        assert len(one.effects) == {"clean": 0, "dirty": 0, "two": 2}.get(one.kind, 1)
        assert bool(OFF & set(one.effects)) == (one.kind == "off")
        assert bool(one.dirt) or one.kind != "dirty"
        make_world(one.effects, level, 20, 1, one.dirt)


def test_engines_can_be_chosen() -> None:
    assert {one.engine for one in drawn("L1", 100, (NUMPY,))} == {NUMPY}
    assert {one.engine for one in drawn("L1", 100, (MUJOCO,))} == {MUJOCO}
    both = drawn("L1", 400)
    assert {one.kind for one in both if one.engine == MUJOCO} == set(SHARES)
    assert 0.15 < sum(one.engine == MUJOCO for one in both) / 400 < 0.25
    with pytest.raises(InputError, match="engines"):
        drawn("L1", 10, ("pybullet",))
    with pytest.raises(InputError, match="level"):
        draw_round(1, 10, "L3", 300)


def test_a_decoys_battery_falls_as_its_balls_wear() -> None:
    plain, decoy = (shoot(make_world({}, "L1", 300, 9, dirt)).shots for dirt in ((), ("battery_with_wear",)))
    order = np.arange(300)
    assert np.corrcoef(order, decoy.number("battery_v"))[0, 1] < -0.8
    assert abs(np.corrcoef(order, plain.number("battery_v"))[0, 1]) < 0.4


@pytest.mark.slow
def test_mujoco_s_worlds_become_data_that_do_not_say_what_is_to_be_believed(tmp_path: Path) -> None:
    drawn = change_robot(np.random.default_rng(1), Drawn("w1", MUJOCO, "one", "L1", 12, 5))
    assert make_data(drawn, tmp_path / "w1").startswith("mujoco ")
    make_more(drawn, [Asked(4.0, 50.0, 0.6, 3)], tmp_path / "more")
    first, more = load_dataset(tmp_path / "w1"), load_dataset(tmp_path / "more")
    assert len(first.shots) == 12 and first.facts.believe.terms == () and first.traces is not None
    assert len(more.shots) == 3 and not set(more.shots.shot_id) & set(first.shots.shot_id)
    assert more.shots.number("distance_m") == pytest.approx([4.0] * 3, abs=0.5)
