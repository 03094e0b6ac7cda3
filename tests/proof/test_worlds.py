"""A round's worlds of either engine: the shares, the ladder, what each kind hides, and that each can be made."""

from collections import Counter
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np
import pytest

import truearc as ta
from truearc import robot
from truearc.robot.config.schema import load_config
from truearc.sim.data.files import load_dataset
from truearc.sim.physics.catalogue import TERMS
from truearc.sim.physics.term import STAGES
from truearc.sim.world.options import Options
from truearc.sim.world.world import Season, ShotSetting
from truearc_proof.rounds import hash_files, worlds
from truearc_proof.rounds.marks import GOES_WITH, hidden_of, right_names, shoot_unseen
from truearc_proof.rounds.worlds import FOREIGN, MUJOCO, NUMPY, SHARES, Change, Drawn, changes_of, dirty_options
from truearc_proof.truth.generate import shoot
from truearc_proof.truth.world import UNCATALOGUED, draw_errors, find_effect, make_world
from truearc_proof.world.season import ORDINARY, Sensors, plan_season, play_season

LEVELS = ("L0", "L1", "L2")
OFF = {effect.name for effect in UNCATALOGUED}


def drawn(level: str, count: int = 400, engines: tuple[str, ...] = (NUMPY, MUJOCO)) -> tuple[Drawn, ...]:
    return worlds.draw_round(11, count, level, 300, engines)


@pytest.mark.parametrize("level", LEVELS)
def test_kinds_come_in_their_shares_and_in_no_order(level: str) -> None:
    kinds = [one.kind for one in drawn(level)]
    assert Counter(kinds) == {kind: round(share * 400) for kind, share in SHARES.items()}
    changes = sum(a != b for a, b in pairwise(kinds))
    assert changes > 250                              # sorted they would change six times


def test_a_small_round_has_as_many_worlds_as_it_was_asked_for() -> None:
    assert drawn("L1") == drawn("L1") != worlds.draw_round(12, 400, "L1", 300)
    for count in range(1, 30):
        round_ = drawn("L1", count)
        assert [one.name for one in round_] == [f"w{number:04d}" for number in range(1, count + 1)]
        assert len({one.seed for one in round_}) == count


@pytest.mark.parametrize("level", LEVELS)
def test_sizes_are_on_the_ladder_or_as_large_as_is_credible(level: str) -> None:
    for one in drawn(level):
        for name, size in one.strength.items():
            factor = abs(one.effects[name]) / abs(find_effect(name).typical)
            assert factor <= worlds.LARGEST + 1e-12
            on_ladder = min(abs(size / step - 1.0) for step in worlds.LADDER) < 1e-9
            assert on_ladder or factor in (1.0, 2.0, 2.5, 3.0, worlds.LARGEST)


@pytest.mark.parametrize("level", LEVELS)
def test_what_is_hidden_is_of_its_kind(level: str) -> None:
    for one in drawn(level):
        if one.engine == MUJOCO:
            continue
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
    with pytest.raises(ta.InputError, match="engines"):
        drawn("L1", 10, ("pybullet",))
    with pytest.raises(ta.InputError, match="level"):
        worlds.draw_round(1, 10, "L3", 300)


def test_foreign_worlds_join_the_others_with_one_change_or_none() -> None:
    every = drawn("L1", 400, worlds.ENGINES)
    made = [one for one in every if one.engine == FOREIGN]
    assert 0.24 < len(made) / 400 < 0.36 and {one.engine for one in every} == set(worlds.ENGINES)
    assert {one.engine for one in drawn("L1", 40, (FOREIGN,))} == {FOREIGN}
    for one in made:
        assert (one.kind == "one") == bool(one.effects) == (one.kind != "clean") and one.dirt == ()
        assert all(abs(size) == dict(worlds.FOREIGN_CHANGES)[name] for name, size in one.effects.items())
    changes = Counter(name for one in made for name in one.effects)
    assert set(changes) == set(dict(worlds.FOREIGN_CHANGES)) and min(changes.values()) > 15
    assert {np.sign(size) for one in made for size in one.effects.values()} == {-1.0, 1.0}


@pytest.mark.parametrize("level", LEVELS)
def test_a_foreign_world_is_an_event_with_its_practice_beside(level: str, tmp_path: Path) -> None:
    one = Drawn("w1", FOREIGN, "one", level, 60, 20041, {"wind_x": 1.5})
    for name in ("w1", "again"):
        worlds.make_data(one, tmp_path / name)
    assert hash_files(tmp_path / "w1") == hash_files(tmp_path / "again")
    event, practice = (load_dataset(tmp_path / name) for name in ("w1", "w1/home"))
    assert [len(each.shots) for each in (event, practice)] == [16, 60]
    assert event.facts == practice.facts and event.facts.believe.terms
    assert (event.tracks is None) == (level != "L2") and "side" in event.shots.texts
    assert right_names(one) == hidden_of(one) == ("wind_x",)
    assert worlds.world_of(one).effects == {**draw_errors(20041), "wind_x": 1.5}
    unseen = shoot_unseen(one)
    assert unseen is not None and len(unseen.above_m) == 16
    assert unseen.dataset.shots.numbers["distance_m"][0] not in event.shots.number("distance_m")


def test_a_decoys_battery_falls_as_its_balls_wear() -> None:
    decoy = shoot(make_world({}, "L1", 300, 9, ("battery_with_wear",))).shots
    assert np.corrcoef(np.arange(300), decoy.number("battery_v"))[0, 1] < -0.8


FACTS = load_config(Path(robot.__file__).parent / "launcher.toml").rig


def of_kind(level: str, kind: str) -> list[Drawn]:
    return [one for one in worlds.draw_round(21, 400, level, 300, (MUJOCO,)) if one.kind == kind]


def sizes(one: Drawn, changes: tuple[Change, ...]) -> set[float]:
    """Of each change, by how many times its usual size it was made."""
    return {(one.effects[name] - float(getattr(Options(), name))) / (value - float(getattr(Options(), name)))
            for change in changes for name, value in change.options.items()}


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("kind", SHARES)
def test_options_are_such_as_a_world_can_have_and_the_same_seed_draws_the_same(level: str, kind: str) -> None:
    made = of_kind(level, kind)
    assert len(made) == round(400 * SHARES[kind]) and made == of_kind(level, kind)
    for one in made:
        told: dict[str, float | bool] = {**one.effects, **dirty_options(one.dirt, one.shots)}
        if "release_arc" in told:
            told["release_arc"] = bool(told["release_arc"])
        msgspec.convert(told, Options)                # within the ranges of a world
        assert one.engine == MUJOCO and one.strength == {}
        assert level == "L2" or not any(change.tracks_only for change in changes_of(one.change))


@pytest.mark.parametrize("level", LEVELS)
def test_in_nulls_nothing_is_changed_and_dirty_ones_are_dirty_in_one_way_or_another(level: str) -> None:
    assert all((one.change, one.effects, one.dirt) == ("nothing", {}, ()) for one in of_kind(level, "clean"))
    dirty = of_kind(level, "dirty")
    assert all((one.change, one.effects, len(one.dirt)) == ("nothing", {}, 1) for one in dirty)
    assert {one.dirt[0] for one in dirty} == set(worlds.dirt_at(level))
    assert ("missing_frames" in worlds.dirt_at(level)) == (level == "L2")


@pytest.mark.parametrize("level", LEVELS)
def test_one_is_one_change_of_the_list_that_benchmarks_have(level: str) -> None:
    for one in of_kind(level, "one"):
        (change,) = changes_of(one.change)
        assert change in worlds.seen_at(level)[1:] and set(one.effects) == set(change.options) and one.dirt == ()


@pytest.mark.parametrize("level", LEVELS)
def test_two_are_two_that_share_neither_option_nor_name_and_are_plain(level: str) -> None:
    for one in of_kind(level, "two"):
        first, second = changes = changes_of(one.change)
        assert changes in worlds.pairs_at(level) and one.change == f"{first.name}{worlds.AND}{second.name}"
        assert not set(first.options) & set(second.options) and not set(first.names) & set(second.names)
        assert set(one.effects) == set(first.options) | set(second.options)
        # a limit of the world (truearc_proof.rounds.worlds.LIMITS) may make a change smaller
        assert {round(size, 9) for size in sizes(one, changes)} <= {*worlds.PLAIN_FACTORS, 1.625, 1.25}


@pytest.mark.parametrize("level", LEVELS)
def test_an_alias_is_a_change_that_only_a_class_of_names_is_right_of_and_turns_either_way(level: str) -> None:
    made = of_kind(level, "alias")
    assert {one.change for one in made} == set(worlds.ALIKE_CHANGES[level])
    told = {round(size, 9) for one in made for size in sizes(one, changes_of(one.change))}
    assert {abs(one) for one in told} <= set(worlds.PLAIN_FACTORS) and min(told) < 0.0 < max(told)


@pytest.mark.parametrize("level", LEVELS)
def test_a_decoy_is_a_battery_beside_worn_balls(level: str) -> None:
    (change,) = changes_of(worlds.WORN_CHANGE)
    for one in of_kind(level, "decoy"):
        assert (one.change, one.dirt) == (worlds.WORN_CHANGE, (worlds.DECOY_DIRT,))
        assert set(one.effects) == set(change.options)
        assert {round(size, 9) for size in sizes(one, (change,))} <= set(worlds.PLAIN_FACTORS)


@pytest.mark.parametrize("level", LEVELS)
def test_what_is_in_no_catalogue_is_none_of_the_changes_that_have_a_name(level: str) -> None:
    made = of_kind(level, "off")
    assert {one.change for one in made} == {change.name for change in worlds.UNCATALOGUED}
    assert not {change.name for change in worlds.UNCATALOGUED} & {change.name for change in worlds.CHANGES}
    for one in made:
        (change,) = changes_of(one.change)
        assert change.names == () and change.stages and set(change.stages) <= set(STAGES)
        assert set(one.effects) == set(change.options) | {name for name, _ in change.beside}
        assert {abs(round(size, 9)) for size in sizes(one, (change,))} <= set(worlds.PLAIN_FACTORS)
        assert dict(change.beside).items() <= one.effects.items()
    signs = {np.sign(one.effects["hood_flex_deg"]) for one in made if one.change == "hood_flex"}
    assert signs == {-1.0, 1.0}


@pytest.mark.parametrize("change", worlds.CHANGES, ids=lambda change: change.name)
def test_a_change_is_one_of_the_world_and_its_names_are_of_the_catalogue(change: Change) -> None:
    changed = Options(**change.options)
    assert (changed == Options()) == (change.name == "nothing")
    assert set(change.names) <= {term.name for term in TERMS}
    assert set(change.stages) <= set(STAGES)
    assert bool(change.names) == bool(change.stages) == bool(change.options)
    at = [level for level in LEVELS if change in worlds.seen_at(level)]
    assert at == (["L2"] if change.name == "cross_wind" else [*LEVELS])      # which tracks alone show


def test_what_has_a_name_of_the_other_engine_is_of_its_stage() -> None:
    known = [change for change in worlds.UNCATALOGUED if change.name in GOES_WITH]
    assert {"hood_flex", "drag_crisis"} <= {change.name for change in known}
    assert all(change.stages == (find_effect(change.name).stage,) for change in known)


def heights_m(season: Season) -> np.ndarray:
    """Where each ball crossed the target's plane [n], in m above the floor; NaN where it fell before it."""
    return np.array([np.nan if one.z_m is None else one.z_m for one in season.results])


def played(options: dict[str, float], settings: list[ShotSetting], sensors: Sensors = ORDINARY,
           level: str = "L0") -> Season:
    return play_season(FACTS, Options(**options), 5, settings, level, sensors)


@pytest.mark.slow
def test_a_decoys_battery_falls_and_does_nothing() -> None:
    """Beside worn balls, which lower the shots by a centimetre already: the same shots with and without its fall."""
    settings, (worn,) = plan_season(9, 60), changes_of(worlds.WORN_CHANGE)
    fresh = played({}, settings)
    plain = played(dict(worn.options), settings, level="L1")
    decoy = played(worn.options | dirty_options((worlds.DECOY_DIRT,), 60), settings, level="L1")
    battery_v = decoy.dataset.shots.number("battery_v")
    moved_m, luck_m = heights_m(decoy) - heights_m(plain), np.std(heights_m(plain) - np.mean(heights_m(plain)))
    assert np.corrcoef(np.arange(60), battery_v)[0, 1] < -0.95
    assert battery_v[:5].mean() - battery_v[-5:].mean() > 0.8 * worlds.FALL_V
    assert np.sqrt(np.mean(moved_m**2)) < 0.005 < 0.05 * luck_m
    along_m = abs(np.polyfit(battery_v, moved_m, 1)[0]) * np.ptp(battery_v)
    wear_m = float(np.mean(heights_m(fresh) - heights_m(plain)))
    assert along_m < 0.01 and wear_m > 0.005


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["dirty", "two", "decoy", "off"])
def test_every_kind_becomes_the_same_data_again(kind: str, tmp_path: Path) -> None:
    one = msgspec.structs.replace(of_kind("L2", kind)[0], shots=12)
    worlds.make_data(one, tmp_path / "w1")
    first = load_dataset(tmp_path / "w1")
    assert len(first.shots) == 12 and first.tracks is not None and first.facts.believe.terms == ()
    worlds.make_data(one, tmp_path / "again")
    assert (tmp_path / "again" / "shots.csv").read_bytes() == (tmp_path / "w1" / "shots.csv").read_bytes()
