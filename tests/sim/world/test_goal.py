"""The opening that faces up in MuJoCo: dropped and thrown balls, against its shapes' definitions and other geometry."""

import math
from pathlib import Path

import numpy as np
import pytest

import truearc as ta
from truearc.cli.main import main
from truearc.robot.config.schema import load_config
from truearc.robot.config.targets import Backboard, Target
from truearc.robot.recording.session import load_trials
from truearc.sim.physics.facing_up import Landing, outcome_of
from truearc.sim.physics.term import Opening
from truearc.sim.world.field import Flight
from truearc.sim.world.goal import Goal
from truearc.sim.world.options import Options
from truearc.sim.world.scene import Ball, Released

RADIUS_M, G = 0.075, 9.81
VACUUM = Options(air_density_kg_m3=0.0)
BALL = Ball("b", 0.215, RADIUS_M, 8000.0, 1.0, 1.0, 0.0, 0.0)
HUB = Target(1.83, facing="up", shape="polygon", across_flats_m=1.06, sides=6)
BOX = Target(0.98, facing="up", shape="rectangle", length_m=0.46, width_m=0.67, backboard=Backboard(0.24, 0.4))
ROUND = Target(2.64, facing="up", shape="circle", radius_m=0.61, tilt_deg=20.0)


def thrown(target: Target, place_m, velocity_m_s) -> Flight:
    flight = Flight(BALL, VACUUM, Released(np.array(place_m, float), np.array(velocity_m_s, float), np.zeros(3)), None,
                    Goal(target))
    while flight.arrival is None:
        flight.step(0.01)
    return flight


def depth_m(target: Target, x: float, y: float) -> float:
    """How far inside the nearest edge a place in the opening's plane is, by the shapes' definitions."""
    if target.shape == "circle":
        return target.radius_m - math.hypot(x, y)
    if target.shape == "rectangle":
        return min(target.length_m / 2 - abs(x), target.width_m / 2 - abs(y))
    return 0.53 - max(abs(x), abs(0.5 * x + math.sqrt(0.75) * y), abs(0.5 * x - math.sqrt(0.75) * y))


@pytest.mark.parametrize("target", [HUB, BOX, ROUND], ids=["hub", "box", "tilted"])
def test_dropped_balls_go_in_where_there_is_room(target: Target) -> None:
    rng, tilt, told = np.random.default_rng(3), math.radians(20.0 if target is ROUND else 0.0), 0
    for along, y in rng.uniform(-0.9, 0.9, (60, 2)):
        deep = depth_m(target, along, y)
        x, rise = along * math.cos(tilt), along * math.sin(tilt)
        if -RADIUS_M < deep < 1.1 * RADIUS_M / math.cos(tilt) or (target is BOX and x > 0.1):     # it may bounce
            continue
        # falls far enough from rest that the rim, not chance, decides
        word = thrown(target, (x, y, target.centre_height_m + rise + 0.3), (0.0, 0.0, -2.0)).arrival.outcome
        told += 1
        assert (word == "two") == (deep > 0.0), (along, y, deep, word)
    assert told > 20


def test_backboard_gives_back_its_share_of_the_speed() -> None:
    flight = Flight(BALL, VACUUM, Released(np.array([-1.0, 0.0, 1.3]), np.array([6.0, 0.0, 1.0]), np.zeros(3)), None,
                    Goal(BOX))
    while flight.data.qvel[0] > 0.0 or flight.data.ncon:
        flight.step(0.0025)
    assert -flight.data.qvel[0] / 6.0 == pytest.approx(0.6, abs=0.04)


def test_words_name_the_side_and_a_ball_that_lacks_height_is_short() -> None:
    up = 4.6                          # 0.3 s above the rim
    assert thrown(HUB, (-3.0, 0.0, 0.75), (2.0, 0.0, up)).arrival.outcome == "miss-low"
    assert thrown(HUB, (-3.0, 0.0, 0.75), (3.0, 0.0, 6.0)).arrival.outcome == "two"
    assert thrown(HUB, (-3.0, 0.0, 0.75), (5.5, 0.0, 6.0)).arrival.outcome == "miss-high"
    assert thrown(HUB, (-3.0, 0.0, 0.75), (3.0, 1.0, 6.0)).arrival.outcome == "miss-left"
    assert thrown(HUB, (-3.0, 0.0, 0.75), (3.0, -1.0, 6.0)).arrival.outcome == "miss-right"
    assert thrown(HUB, (-1.5, 0.0, 0.75), (2.0, 0.0, 3.0)).arrival.outcome == "miss-low"


@pytest.mark.slow
def test_throws_end_as_the_geometry_of_the_likelihood_has_it() -> None:
    rng, agree, n = np.random.default_rng(5), 0, 150
    for _ in range(n):
        angle, x, y = math.radians(rng.uniform(58.0, 72.0)), -rng.uniform(2.0, 4.5), rng.normal(0.0, 0.15)
        rise = HUB.centre_height_m - 0.75
        speed = math.sqrt(G * x * x / (2.0 * math.cos(angle)**2 * (-x * math.tan(angle) - rise))) * (
            1.0 + rng.normal(0.0, 0.06))
        ahead, up = speed * math.cos(angle), speed * math.sin(angle)
        word = thrown(HUB, (x, y, 0.75), (ahead, 0.0, up)).arrival.outcome
        falls = math.sqrt(max(up * up - 2.0 * G * rise, 0.0))
        along, begin = (x + ahead * (up + sign * falls) / G for sign in (1.0, -1.0))
        landing = Landing(*(np.array([one]) for one in (along, y, math.atan2(falls, ahead), 1.0, begin, False)))
        level, _ = outcome_of(HUB, RADIUS_M, landing, Opening(1.83, 0.0, 0.53))
        agree += (word == "two") == bool(level[0])
    assert agree >= 0.9 * n           # the others touch the rim


@pytest.mark.slow
def test_emulated_robot_shoots_at_the_hub_of_a_game(tmp_path: Path) -> None:
    path, folder = tmp_path / "launcher.toml", tmp_path / "s"
    assert main(["init", "--game", "frc-2026", "--robot", str(path)]) == 0
    balls = ta.emulate(load_config(path), folder, 12, 3).balls
    trials = {trial.outcome.trial: trial for trial in load_trials(folder)}
    assert len(balls) > 8 and sum(ball.outcome == "two" for ball in balls) > 4
    for trial in trials.values():
        if trial.shot is not None:    # the tag on the hub tells the distance of its middle
            ball = min(balls, key=lambda one: abs(one.exit_t_ns - trial.shot.t_ns))
            assert trial.shot.distance_m == pytest.approx(ball.distance_m, abs=0.08)
    dataset = ta.shots_from_sessions([folder], "s")
    assert dataset.rig.target is not None and dataset.rig.target.faces_up
    assert set(dataset.shots.text("side")) <= {"", "short", "long", "left", "right"}
