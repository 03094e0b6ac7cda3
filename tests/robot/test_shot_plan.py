"""The collection plan, its ballistics, and prescribed shots, whose errors are named by file, line and column."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from tests.robot.good_tick import CONFIG, DISTANCE_M, HOOD_DEG, good_inputs, good_memory
from truearc.cli.common import SHIPPED
from truearc.cli.main import main
from truearc.errors import InputError
from truearc.robot.aim import aim, config_id, plan, step_walk, vacuum_speed_m_s, walked
from truearc.robot.aim_file import load_plan, with_plan
from truearc.robot.config.schema import Prescribed
from truearc.robot.estimate import estimate
from truearc.robot.types import Shot


@given(st.floats(1.0, 12.0), st.floats(0.5, 2.5), st.floats(20.0, 74.0))
def test_the_vacuum_speed_hits_the_target(distance_m, rise_m, elevation_deg):
    speed = vacuum_speed_m_s(distance_m, rise_m, elevation_deg, 9.81)
    angle = math.radians(elevation_deg)
    if speed is None:
        assert distance_m * math.tan(angle) <= rise_m
        return
    flight = distance_m / (speed * math.cos(angle))
    assert math.isclose(speed * math.sin(angle) * flight - 9.81 * flight**2 / 2, rise_m, abs_tol=1e-6)


def test_the_plan_fills_hood_range_and_speeds_evenly_and_repeats_what_it_should():
    shares, trims = np.array([plan(trial, CONFIG.collect) for trial in range(300)]).T
    for third in range(3):
        assert 90 <= np.sum((shares >= third / 3) & (shares < (third + 1) / 3)) <= 110
    assert np.max(np.abs(trims)) <= CONFIG.collect.spread
    assert abs(np.mean(trims)) < 0.01


def shot(distance_m, trial, hood_deg=45.0):
    return Shot(trial, 0, "c", distance_m, 0.02, hood_deg, 0.5, 300.0, 12.0, None, None, None)


def test_marks_walk_the_speed_but_for_what_the_trim_explains():
    collect = CONFIG.collect
    small = next(trial for trial in range(100) if abs(plan(trial, collect)[1]) < 0.1 * collect.spread)
    walk = (0.0, 0.0, 0.0)
    for _ in range(5):
        walk = step_walk(walk, -1, shot(8.0, small), CONFIG)
    assert walked(walk, 8.0, 45.0) > walked(walk, 5.0, 45.0) > 0.0
    assert step_walk(walk, 0, shot(8.0, small), CONFIG) == walk
    collect = CONFIG.collect
    fast = next(trial for trial in range(100) if plan(trial, collect)[1] > 0.5 * collect.spread)
    assert step_walk((0.0, 0.0, 0.0), 1, shot(5.0, fast), CONFIG) == (0.0, 0.0, 0.0)
    assert step_walk((0.0, 0.0, 0.0), -1, shot(5.0, fast), CONFIG)[0] > 0.0


ROWS = (Prescribed(DISTANCE_M, 0.5, HOOD_DEG), Prescribed(7.0, 0.625, 33.0))


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def test_columns_may_stand_in_any_order_and_a_dataset_is_a_plan(tmp_path):
    file = write(tmp_path / "p.csv", "hood_deg,name,distance_m,motor_ratio\n50,a,5,0.5\n33,b,7.0,0.625\n")
    assert load_plan(file, CONFIG) == ROWS
    write(tmp_path / "shots.csv", "shot_id,distance_m,hood_deg,motor_ratio,outcome\ns1,7.0,33.0,0.625,two\n")
    assert load_plan(tmp_path, CONFIG) == ROWS[1:]


@settings(deadline=None)
@given(rows=st.lists(st.tuples(st.floats(0.1, 30.0), st.floats(0.01, 1.0), st.floats(15.0, 75.0)), min_size=1))
def test_what_is_written_is_read_to_the_bit(tmp_path_factory, rows):
    text = "distance_m,motor_ratio,hood_deg\n" + "".join(f"{d!r},{r!r},{h!r}\n" for d, r, h in rows)
    file = write(tmp_path_factory.mktemp("plan") / "p.csv", text)
    assert [(row.distance_m, row.motor_ratio, row.hood_deg) for row in load_plan(file, CONFIG)] == rows


@pytest.mark.parametrize(("text", "message"), [
    ("distance_m,motor_ratio\n5,0.5\n", r"p\.csv:1: columns hood_deg are missing; a plan has them"),
    ("", r"p\.csv:1: columns distance_m, motor_ratio, hood_deg are missing"),
    ("distance_m,motor_ratio,hood_deg\n", "no rows"),
    ("distance_m,motor_ratio,hood_deg\n5,0.5,45\n5,1.01,45\n", r"p\.csv:3: motor_ratio: 1\.01 is out of the .*0 to 1"),
    ("distance_m,motor_ratio,hood_deg\n5,0.5,14\n", r"p\.csv:2: hood_deg: 14 is out of the .*15 to 75"),
    ("distance_m,motor_ratio,hood_deg\n5,0,45\n", "motor_ratio: 0 is out"),
    ("distance_m,motor_ratio,hood_deg\n5,nan,45\n", "motor_ratio: 'nan' is not a number"),
    ("distance_m,motor_ratio,hood_deg\ninf,0.5,45\n", "distance_m: inf is out"),
    ("distance_m,motor_ratio,hood_deg\n5,,45\n", "motor_ratio: '' is not a number"),
    ("distance_m,motor_ratio,hood_deg\n5,0.5\n", "hood_deg: '' is not a number"),
    ("distance_m,motor_ratio,hood_deg\n" + "5,2,45\n" * 9, "and 4 more"),
])
def test_a_row_that_cannot_be_is_named(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        load_plan(write(tmp_path / "p.csv", text), CONFIG)


@pytest.mark.parametrize("verb", [["emulate", "--out", "s"], ["run", "--config", str(SHIPPED)]])
def test_the_verbs_refuse_it_with_exit_code_2_and_leave_nothing(verb, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "p.csv", "distance_m,motor_ratio,hood_deg\n5,0.5,80\n")
    assert main([*verb, "--plan", "p.csv"]) == 2
    assert "p.csv:2: hood_deg: 80" in capsys.readouterr().err
    assert main([*verb, "--plan", "nowhere.csv"]) == 2
    assert "nowhere.csv" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["p.csv"]


@pytest.mark.parametrize("words", [[], ["--trials", "5"], ["--repeats", "0"]])
def test_how_many_must_be_possible(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "p.csv", "distance_m,motor_ratio,hood_deg\n5,0.5,45\n")
    plan = ["--plan", "p.csv"] if words else []
    assert main(["emulate", "--out", "s", *plan, *words, "--quiet"]) == 2
    assert "--trials" in (said := capsys.readouterr().err) or "--repeats" in said
    assert not (tmp_path / "s").exists()


PLANNED = with_plan(CONFIG, ROWS, repeats=2)


def aim_at(trial, config=PLANNED):
    memory = replace(good_memory(), trial=trial, aim=None)
    return aim(estimate(good_inputs(), memory, config), memory, config)


def test_each_row_is_shot_as_often_as_asked_and_marks_walk_nothing():
    assert (aim_at(0).motor_ratio, aim_at(0).hood_deg, aim_at(0).source) == (0.5, HOOD_DEG, "plan")
    assert aim_at(1) == aim_at(0)
    assert (aim_at(2).motor_ratio, aim_at(2).hood_deg) == (0.625, 33.0)
    assert aim_at(4).source == "idle"
    assert [config_id(trial, PLANNED.collect) for trial in range(4)] == ["c0000", "c0000", "c0001", "c0001"]
    shot = Shot(0, 0, "c", 8.0, 0.02, 45.0, 0.5, 300.0, 12.0, None, None, None)
    assert step_walk((0.1, 0.0, 0.0), -1, shot, PLANNED) == (0.1, 0.0, 0.0)
    assert step_walk((0.1, 0.0, 0.0), -1, shot, CONFIG) != (0.1, 0.0, 0.0)
