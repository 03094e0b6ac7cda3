"""Set points for an opening that faces up: against flights of the geometry, closed forms, and the robot's aim file."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

import truearc as ta
from tests.sim.infer.hubs import CD, CL, HUB, LOSS, OPENING, RIG
from truearc.robot.aim_file import load_aim
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.targets import Ring
from truearc.sim.aim.make_table import flown, on_the_move
from truearc.sim.aim.solve import chances_of
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.infer.belief import Belief, point_belief
from truearc.sim.physics.catalogue import flight_terms
from truearc.sim.physics.facing_up import land, outcome_of
from truearc.sim.physics.simulate import launch_of
from truearc.sim.physics.term import Exit

SPEED, ELEVATION_DEG = 0.03, 1.0
DOUBT = 0.05                          # of the log of drag
BELIEF = Belief({"drag": {"cd": CD}, "magnus": {"cl": CL}, "exit_efficiency": {"loss": LOSS}},
                {"speed": SPEED, "elevation_deg": ELEVATION_DEG}, ("drag.cd",), np.array([[DOUBT**2]]))
DISTANCES_M = (2.0, 2.5, 3.0, 3.5, 4.0, 4.5)


@pytest.fixture(scope="module")
def table() -> ta.AimTable:
    return ta.aim(BELIEF, RIG, distances_m=DISTANCES_M, hood_deg=(54.0, 70.0))


def share_of_hits(distance_m: float, hood_deg: float, ratio: float, flights: int = 4000) -> float:
    """Of flights with all that scatters, by the simulator and the geometry of the rim."""
    rng, noise = np.random.default_rng(5), RIG.noise
    draw = rng.normal(size=(5, flights))
    leaving = launch_of(RIG, Shots(("a",), {"hood_deg": np.array([hood_deg]), "motor_ratio": np.array([ratio])}, {}))
    wheel = noise.wheel_rad_s * RIG.launcher.wheel[0].radius_m / float(leaving.speed_m_s[0]) / np.sqrt(2.0)
    exit = Exit(leaving.speed_m_s * (1.0 - LOSS) * np.exp(draw[0] * np.hypot(SPEED, wheel)),
                np.radians(hood_deg + draw[1] * np.hypot(ELEVATION_DEG, noise.hood_deg)),
                np.full(flights, leaving.spin_rev_s[0]))
    far_m = distance_m + draw[2] * noise.distance_m
    landing = land(RIG, flight_terms(("gravity", "drag", "magnus")), {"drag": {"cd": CD * np.exp(DOUBT * draw[3])},
                   "magnus": {"cl": CL}}, exit, far_m, OPENING)
    landing = landing._replace(across_m=(np.asarray(landing.along_m) + far_m) * np.sin(0.007 * draw[4]))
    return float(outcome_of(HUB, RIG.ball.radius_m, landing, OPENING)[0].mean())


@pytest.mark.parametrize("off", [1.0, 0.96, 1.05])
def test_hit_probabilities_are_those_of_flights(table: ta.AimTable, off: float) -> None:
    for row in table.rows[::2]:
        chance = chances_of(RIG, BELIEF, *(np.array([one]) for one in (row.distance_m, row.hood_deg,
                                                                      row.motor_ratio * off)))
        seen = share_of_hits(row.distance_m, row.hood_deg, row.motor_ratio * off)
        assert chance.p_two[0] == pytest.approx(seen, abs=0.02)


def test_no_other_hood_or_speed_hits_noticeably_more(table: ta.AimTable) -> None:
    row = table.rows[-1]
    for hood_deg in (row.hood_deg - 5.0, row.hood_deg + 5.0):
        for off in (0.98, 1.0, 1.02):
            assert share_of_hits(row.distance_m, hood_deg, row.motor_ratio * off) < row.p_two + 0.025


def test_table_counts_points_of_the_game_and_shows_the_angle(table: ta.AimTable) -> None:
    for row in table.rows:
        assert row.points == row.p_two and row.p_three == 0.0
        assert row.arrival_deg == pytest.approx(np.degrees(arrival(row).angle_rad[0]))
        assert 50.0 < row.arrival_deg < row.hood_deg + 5.0
    text = str(table)
    assert "P(hit)" in text and "arrives deg" in text and "three" not in text
    assert "hoodDeg.put(2.000" in table.to_java() and "{4.500, " in table.to_cpp()


def arrival(row):
    return flown(RIG, BELIEF, *(np.array([one]) for one in (row.distance_m, row.hood_deg, row.motor_ratio)))


def test_ball_on_the_move_in_a_vacuum_keeps_the_velocity_of_the_robot() -> None:
    air = point_belief({"exit_efficiency": {"loss": 0.0}}, {"speed": 0.02, "elevation_deg": 0.5})
    at = np.array([3.0]), np.array([62.0]), np.array([0.28])
    speed = float(launch_of(RIG, Shots.of_settings(*at)).speed_m_s[0])
    up, rise = speed * np.sin(np.radians(62.0)), HUB.centre_height_m - RIG.launcher.release_height_m
    falls_s = (up + np.sqrt(up**2 - 2.0 * 9.80665 * rise)) / 9.80665
    come = flown(RIG, air, *at)
    assert come.flown_s[0] == pytest.approx(falls_s, abs=1e-3)
    moving = on_the_move(RIG, air, *at, come.flown_s)
    assert moving.carry_s[0] == pytest.approx(falls_s, abs=2e-3) == moving.sideways_s[0]
    assert abs(moving.trim_s_m[0]) < 1e-3 and abs(moving.sink_s2_m2[0]) < 1e-3


def test_robot_reads_the_aim_file_of_a_hub(table: ta.AimTable, tmp_path) -> None:
    check = ta.export_aim(table, BELIEF, RIG, tmp_path / "aim.json", note="hub")
    assert check.passed
    aim = load_aim(tmp_path / "aim.json")
    for row in table.rows:
        point = aim.at(row.distance_m)
        assert (point.hood_deg, point.motor_ratio) == pytest.approx((row.hood_deg, row.motor_ratio))
    moving = aim.moving(3.0, 1.0, 0.0, 0.0)
    assert moving is not None and moving.virtual_m < 3.0


def rig_with(**changes) -> Rig:
    return msgspec.structs.replace(RIG, target=msgspec.structs.replace(HUB, **changes))


def test_ring_counts_more_and_a_rim_above_all_shots_is_refused() -> None:
    ringed = ta.aim(BELIEF, rig_with(points=2.0, ring=Ring(0.15, 5.0)), distances_m=[3.0], hood_deg=(58.0, 66.0))
    row = ringed.rows[0]
    assert row.points == pytest.approx(2.0 * row.p_two + 3.0 * row.p_three) and 0.1 < row.p_three < row.p_two
    assert "P(ring)" in str(ringed) and "three" not in str(ringed)
    with pytest.raises(ta.InputError, match="no ball comes so high at the motors' free speed"):
        ta.aim(replace(BELIEF, coefficients=BELIEF.coefficients | {"drag": {"cd": 8.0}}), rig_with(centre_height_m=9.0),
               distances_m=[3.0])


def test_predictions_state_the_probability_of_a_hit(table: ta.AimTable) -> None:
    row = table.rows[2]
    shots = Shots.of_settings(np.full(3, row.distance_m), np.full(3, row.hood_deg),
                              row.motor_ratio * np.array([1.0, 0.96, 0.7]))
    said = ta.predict(Dataset("later", RIG, shots), BELIEF)
    chance = [line[said.columns.index("p_hit")] for line in said.rows]
    assert chance[0] == pytest.approx(row.p_two, abs=0.02) and chance[2] < 1e-3
    assert chance[1] == pytest.approx(share_of_hits(row.distance_m, row.hood_deg, 0.96 * row.motor_ratio), abs=0.02)
