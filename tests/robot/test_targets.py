"""Targets that face up in rig.toml: shapes and sizes, what is refused, and what old files mean."""

from pathlib import Path

import msgspec
import pytest

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Ball, Rig, Target
from truearc.robot.config.shot_map import MARKS
from truearc.robot.config.targets import Ring
from truearc.sim.data.files import load_dataset, load_rig, save_rig
from truearc.sim.data.import_shots import import_shots

HUB = """
[ball]
mass_kg = 0.215
radius_m = 0.075

[target]
facing = "up"
centre_height_m = 1.83
shape = "polygon"
across_flats_m = 1.06
sides = 6
"""
BASKET = HUB.replace('shape = "polygon"\nacross_flats_m = 1.06\nsides = 6', 'shape = "circle"\nradius_m = 0.6')


def rig_of(tmp_path: Path, text: str) -> Rig:
    path = tmp_path / "rig.toml"
    path.write_text(text)
    return load_rig(path)


def test_opening_that_faces_up_has_half_sizes_of_its_shape(tmp_path):
    hub = rig_of(tmp_path, HUB).target
    assert hub.faces_up and hub.hit_or_miss and hub.half_sizes_m == pytest.approx((0.53, 0.53 / 0.75**0.5))
    assert (hub.two_half_height_m, hub.three_half_height_m, hub.word("two")) == (0.53, 0.0, "hit")
    goal = Target(1.0, facing="up", shape="rectangle", length_m=0.4, width_m=0.6, ring=Ring(0.1, 4.0))
    assert goal.half_sizes_m == (0.2, 0.3) and goal.three_half_height_m == 0.1 and not goal.hit_or_miss
    assert Target(1.0, facing="up", shape="polygon", across_flats_m=1.0, sides=8).half_sizes_m == (0.5, 0.5)


def test_rig_that_faces_up_is_the_same_after_saving(tmp_path):
    rig = rig_of(tmp_path, HUB + "tilt_deg = 10\npoints = 1\n[target.ring]\nradius_m = 0.2\npoints = 2\n"
                 "[target.backboard]\nbehind_m = 0.6\nheight_m = 0.7\n")
    save_rig(tmp_path / "again.toml", rig)
    assert load_rig(tmp_path / "again.toml") == rig


def test_upright_target_is_written_as_before():
    assert msgspec.json.encode(Target(2.44)) == (
        b'{"centre_height_m":2.44,"three_half_height_m":0.07,"two_half_height_m":0.35}')
    assert Rig(Ball(0.14, 0.09), target=Target(2.44)).target.faces_up is False


@pytest.mark.parametrize(("old", "new", "message"), [
    ('shape = "circle"', "", r"rig\.toml: target\.shape: missing key; .* circle, rectangle, polygon"),
    ("radius_m = 0.6", "", r"target\.radius_m: missing key; a circle has radius_m"),
    ("radius_m = 0.6", "radius_m = 0.6\nlength_m = 1.0", r"target\.length_m: is the size of a rectangle"),
    ("radius_m = 0.6", "radius_m = 0.07", r"target\.radius_m: the opening is 0\.14 m .* less than the ball's 0\.15 m"),
    ("radius_m = 0.6", "radius_m = 0.6\ntilt_deg = 80", r"target\.tilt_deg: 80 is out of range"),
    ("radius_m = 0.6", "radius_m = 0.6\ntwo_half_height_m = 0.35", r"target\.two_half_height_m: is of an upright"),
    ("radius_m = 0.6", "radius_m = 0.6\n[target.ring]\nradius_m = 0.7\npoints = 2", r"target\.ring\.radius_m: 0\.7 is"),
    ("radius_m = 0.6", "radius_m = 0.6\n[target.backboard]\nbehind_m = 0.5\nheight_m = 1",
     r"target\.backboard\.behind_m: 0\.5 is inside the opening"),
    ('facing = "up"', "", r"target\.radius_m: is of an opening that faces up; state facing"),
    ('facing = "up"', 'facing = "down"', r"target\.facing"),
    ('shape = "circle"\nradius_m = 0.6', 'shape = "polygon"\nacross_flats_m = 1.0\nsides = 5',
     r"target\.sides: 5 must be an even number"),
])
def test_impossible_opening_is_refused_with_its_key(tmp_path, old, new, message):
    with pytest.raises(InputError, match=message):
        rig_of(tmp_path, BASKET.replace(old, new, 1))


@pytest.mark.parametrize(("rig", "side", "message"), [
    (BASKET, "low", r"shots\.csv:2: side: is low, .* rig\.toml faces up: write short; here and in 1 more"),
    (BASKET.replace('facing = "up"', "").replace('shape = "circle"\nradius_m = 0.6', ""), "long",
     r"shots\.csv:2: side: is long, but the opening of rig\.toml faces the launcher: write high")])
def test_side_of_another_facing_is_refused_with_the_right_word(tmp_path, rig, side, message):
    (tmp_path / "rig.toml").write_text(rig)
    (tmp_path / "shots.csv").write_text("shot_id,distance_m,hood_deg,outcome,side\n"
                                        f"a,3,60,miss,{side}\nb,3,60,miss,{side}\n")
    with pytest.raises(InputError, match=message):
        load_dataset(tmp_path)


@pytest.mark.parametrize(("mark", "up", "front"), [
    ("miss-low", ("miss", "short"), ("miss", "low")), ("miss-long", ("miss", "long"), ("miss", "high")),
    ("miss-left", ("miss", "left"), ("miss", "left")), ("two-low", ("two", ""), ("two", "low")),
    ("hit", ("hit", ""), ("hit", ""))])
def test_marks_are_noted_in_the_words_of_the_opening(tmp_path, mark, up, front):
    hub = rig_of(tmp_path, HUB).target
    assert hub.noted(*MARKS[mark]) == up and Target(2.0).noted(*MARKS[mark]) == front


def test_points_of_a_hit_are_those_of_the_game():
    hub = Target(1.0, facing="up", shape="circle", radius_m=0.5)
    assert hub.worth == (1.0, 1.0) and Target(2.0).worth == (2.0, 3.0)
    ringed = Target(1.0, facing="up", shape="circle", radius_m=0.5, points=2.0, ring=Ring(0.1, 5.0))
    assert ringed.worth == (2.0, 5.0)


def test_table_of_a_team_is_imported_with_sides_of_a_hub(tmp_path):
    (tmp_path / "rig.toml").write_text(HUB)
    (tmp_path / "mine.csv").write_text("d,angle,result\n3,60,in\n3,60,short\n3,60,wide\n")
    (tmp_path / "shots.toml").write_text(
        'schema = "truearc.shot-map/1"\nrows = "shot"\n[columns]\ndistance_m = "d"\nhood_deg = "angle"\n'
        '[outcome]\nkey = "result"\nvalues = { in = "hit", short = "miss-low", wide = "miss-left" }\n')
    shots = import_shots([tmp_path / "mine.csv"], rig=tmp_path / "rig.toml", shot_map=tmp_path / "shots.toml").shots
    assert shots.text("outcome") == ("two", "miss", "miss") and shots.text("side") == ("", "short", "left")


def test_hits_and_misses_with_sides_are_read(tmp_path):
    (tmp_path / "rig.toml").write_text(BASKET)
    (tmp_path / "shots.csv").write_text("shot_id,distance_m,hood_deg,outcome,side\na,3,60,hit,\nb,3,60,miss,short\n"
                                        "c,3,60,miss,left\n")
    dataset = load_dataset(tmp_path)
    assert "3 shots (1 hit, 2 miss)" in dataset.lines()[0] and "1 short, 1 left" in "\n".join(dataset.lines())


def test_buttons_follow_the_target() -> None:
    hub = Target(1.83, facing="up", shape="circle", radius_m=0.6)
    pressed = ("miss-low", "miss-high", "miss-left", "miss-right", "two")
    assert [hub.button(name) for name in pressed] == ["short", "long", "left", "right", "hit"]
    assert [Target(2.44).button(name) for name in pressed] == list(pressed)
