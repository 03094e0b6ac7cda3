"""Shots from a robot that drives, flown by SciPy's DOP853 with the robot's velocity added: the ball still scores."""

import math

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace
from scipy.integrate import solve_ivp

import truearc as ta
from tests.robot.good_tick import NOW_NS, good_inputs, good_memory, seconds
from truearc.cli.common import SHIPPED
from truearc.robot.aim_file import AimFile, load_aim_for
from truearc.robot.config.schema import AimConfig, Config, load_config
from truearc.robot.gate import Rating
from truearc.robot.tick import step
from truearc.robot.types import RobotVelocity, Sighting, Tick
from truearc.sim.infer.belief import point_belief
from truearc_frc.table import Nt4, Nt4Velocity, with_nt4

CD, CL, LOSS = 0.45, 0.1, 0.38
BELIEF = point_belief({"drag": {"cd": CD}, "magnus": {"cl": CL}, "exit_efficiency": {"loss": LOSS}},
                      {"speed": 0.015, "elevation_deg": 0.5})
SHIPPED_CONFIG = load_config(SHIPPED)
RIG = SHIPPED_CONFIG.rig
VELOCITY = Nt4Velocity("/Drive/Speeds", most_m_s=2.5, pointing_deg=2.0)
FREE = RIG.launcher.free_speed_rad_s or 0.0
TARGET = RIG.target


def config(velocity: Nt4Velocity = VELOCITY) -> Config:
    return with_nt4(replace(SHIPPED_CONFIG, aim=AimConfig("belief", 0.005)), Nt4("254", velocity=velocity))


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> AimFile:
    path = tmp_path_factory.mktemp("aim") / "aim.json"
    table = ta.aim(BELIEF, RIG, distances_m=np.arange(1.5, 9.1, 0.25), hood_deg=(30.0, 54.0))
    ta.export_aim(table, BELIEF, RIG, path)
    return load_aim_for(path, SHIPPED_CONFIG)


def passes(hood_deg: float, motor_ratio: float, lead_deg: float, distance_m: float, toward_m_s: float,
           left_m_s: float) -> tuple[float, float]:
    """(height over the centre, place to the left of it) where the ball crosses the target's plane, by DOP853."""
    surfaces = {wheel.name: wheel.radius_m * wheel.gear * FREE * motor_ratio for wheel in RIG.launcher.wheel}
    spin_rev_s = (surfaces["lower"] - surfaces["upper"]) / (2.0 * math.pi * RIG.ball.radius_m)
    speed = 0.5 * sum(surfaces.values()) * (1.0 - LOSS)
    hood, lead = math.radians(hood_deg), math.radians(lead_deg)
    launch = speed * np.array([math.cos(hood) * math.cos(lead), math.cos(hood) * math.sin(lead), math.sin(hood)])
    spin = spin_rev_s * np.array([math.sin(lead), -math.cos(lead), 0.0])                 # backspin
    per_kg = RIG.air.density_kg_m3 / RIG.ball.mass_kg
    drag = 0.5 * CD * math.pi * RIG.ball.radius_m**2 * per_kg
    lift = CL * 4.0 / 3.0 * 4.0 * math.pi**2 * RIG.ball.radius_m**3 * per_kg

    def rate(t_s: float, state: np.ndarray) -> np.ndarray:
        v = state[3:]
        down = np.array([0.0, 0.0, RIG.world.gravity_m_s2])
        return np.concatenate([v, lift * np.cross(spin, v) - drag * np.linalg.norm(v) * v - down])

    def there(t_s: float, state: np.ndarray) -> float:
        return float(state[0] - distance_m)

    there.terminal = True                                # type: ignore[attr-defined]
    start = [0.0, 0.0, RIG.launcher.release_height_m, *(launch + np.array([toward_m_s, left_m_s, 0.0]))]
    flown = solve_ivp(rate, (0.0, 6.0), start, "DOP853", events=there, rtol=1e-9, atol=1e-9)
    return float(flown.y[2, -1] - TARGET.centre_height_m), float(flown.y[1, -1])         # type: ignore[union-attr]


WAYS = [(speed * math.cos(way), speed * math.sin(way)) for speed in (1.0, 2.0) for way in np.radians(range(0, 360, 45))]


@pytest.mark.parametrize("distance_m", [2.5, 4.0, 5.5, 7.0])
def test_the_ball_scores_from_a_robot_that_drives(distance_m: float, file: AimFile) -> None:
    rest = file.at(distance_m)
    unled = []
    for toward, left in [(0.0, 0.0), *WAYS]:
        moving = file.moving(distance_m, toward, left, 0.0)
        assert moving is not None, (toward, left)
        up, side = passes(moving.point.hood_deg, moving.point.motor_ratio * math.exp(moving.trim),
                          moving.point.lead_deg + moving.lead_deg, distance_m, toward, left)
        assert abs(up) < 0.015 and abs(side) < 0.03, (toward, left, up, side)
        unled.append(max(map(abs, passes(rest.hood_deg, rest.motor_ratio, 0.0, distance_m, toward, left))))
    assert np.median(unled[1:]) > 0.25                   # as if it stood, most would miss the inner opening by far


def test_the_ball_leaves_late_and_scores_from_there(file: AimFile) -> None:
    delay_s, toward, left = 0.2, 1.5, 1.0
    moving = file.moving(5.0, toward, left, delay_s)
    place = np.array([toward, left]) * delay_s           # where the robot is by then
    line = math.atan2(-place[1], 5.0 - place[0])         # to the target, as seen from there
    along, across = np.array([[math.cos(line), math.sin(line)], [-math.sin(line), math.cos(line)]]) @ [toward, left]
    up, side = passes(moving.point.hood_deg, moving.point.motor_ratio * math.exp(moving.trim),
                      moving.lead_deg - math.degrees(line), float(np.hypot(5.0 - place[0], place[1])), along, across)
    assert abs(up) < 0.015 and abs(side) < 0.03


@pytest.mark.parametrize(("toward", "left"), [(9.0, 0.0), (-9.0, 0.0), (0.0, 12.0), (math.nan, 0.0), (0.0, math.inf)])
def test_beyond_what_the_file_knows_there_is_no_set_point(toward: float, left: float, file: AimFile) -> None:
    assert file.moving(5.0, toward, left, 0.0) is None


class Asked:
    """A gate that agrees and keeps what it was asked."""

    sha256 = ""

    def __init__(self) -> None:
        self.questions: list[tuple[float, float, float]] = []

    def rate(self, distance_m: float, motor_ratio: float, hood_deg: float) -> Rating:
        self.questions.append((distance_m, motor_ratio, hood_deg))
        return Rating(0.9, 0.9, True, 0.0)


def drive(forward: float, left: float, aims: dict[str, AimFile], bearing_deg: float = 0.0, age_s: float = 0.01,
          facts: Config | None = None, velocity: bool = True) -> tuple[Tick, Asked]:
    """Two ticks: one to aim, one with wheels and hood there, and the target where the lead has it."""
    gate, facts = Asked(), facts or replace(config(), gate=replace(config().gate, policy="model"))
    moves = RobotVelocity(NOW_NS - seconds(age_s), forward, left)
    bearing, speed, hood = bearing_deg, 200.0, 45.0
    for _ in range(2):
        seen = Sighting(NOW_NS - seconds(0.001), True, None, 5.0 + facts.camera.behind_exit_m, 0.03, bearing)
        memory = replace(good_memory(), aim=None, aim_place_m=None, last_sighting=seen)
        inputs = good_inputs(speed, hood)
        inputs = replace(inputs, velocity=moves) if velocity else inputs
        tick = step(inputs, memory, facts, gate, aims)   # type: ignore[arg-type]
        speed, hood = tick.aim.motor_ratio * FREE, tick.aim.hood_deg
    return tick, gate


def test_a_tick_leads_fires_and_asks_the_gate_as_of_a_robot_at_rest(file: AimFile) -> None:
    moving = file.moving(5.0, 1.2, 0.0, 0.0)
    tick, gate = drive(1.2, 0.0, {"": file})
    assert tick.verdict.fire and tick.shot is not None and tick.shot.speed_m_s == pytest.approx(1.2)
    assert tick.aim.virtual_m == pytest.approx(moving.virtual_m) and moving.virtual_m < 4.6
    rest = file.at(moving.virtual_m)
    assert gate.questions[-1] == pytest.approx((moving.virtual_m, rest.motor_ratio, rest.hood_deg), rel=1e-6)
    up, side = passes(tick.aim.hood_deg, tick.aim.motor_ratio, 0.0, 5.0, 1.2, 0.0)
    assert abs(up) < 0.02 and abs(side) < 1e-6
    decoded = msgspec.json.decode(msgspec.json.encode(tick), type=Tick)
    assert decoded == tick                               # what is recorded says it all


def test_the_launcher_must_point_by_the_lead(file: AimFile) -> None:
    ahead, _ = drive(0.0, 1.2, {"": file})               # it points at the target, and drives across
    assert [reason.code for reason in ahead.verdict.reasons] == ["not_led"]
    bearing = 0.0
    for _ in range(20):                                  # its own velocity turns with it
        tick, _ = drive(1.2 * math.sin(math.radians(bearing)), 1.2 * math.cos(math.radians(bearing)), {"": file},
                        bearing)
        bearing = float(tick.aim.lead_deg)               # type: ignore[arg-type]
    assert -14.0 < bearing < -8.0 and tick.verdict.fire
    up, side = passes(tick.aim.hood_deg, tick.aim.motor_ratio, bearing, 5.0, 0.0, 1.2)
    assert abs(up) < 0.015 and abs(side) < 0.03


@pytest.mark.parametrize(("kwargs", "code"), [
    ({"velocity": False}, "robot_speed_unknown"), ({"age_s": 0.2}, "robot_speed_unknown"),
    ({"age_s": -0.1}, "robot_speed_unknown")])
def test_a_velocity_that_is_missing_or_old_is_a_hold_aimed_as_at_rest(kwargs, code, file):
    tick, _ = drive(1.2, 0.0, {"": file}, **kwargs)      # type: ignore[arg-type]
    assert [reason.code for reason in tick.verdict.reasons] == [code]
    assert tick.aim.hood_deg == file.at(5.0).hood_deg    # type: ignore[union-attr]


def test_a_robot_too_fast_or_without_a_set_point_for_it_holds(file: AimFile) -> None:
    assert "robot_too_fast" in [reason.code for reason in drive(2.6, 0.0, {"": file})[0].verdict.reasons]
    old = AimFile(replace(file.content, segments=tuple(replace(one, motion=msgspec.UNSET)
                                                       for one in file.content.segments)), "b" * 64)
    assert "robot_moves" in [reason.code for reason in drive(1.0, 0.0, {"": old})[0].verdict.reasons]
    assert drive(0.01, 0.0, {"": old})[0].verdict.fire
    by_plan = replace(config(), aim=AimConfig("plan", 0.0))
    assert "robot_moves" in [reason.code for reason in drive(1.0, 0.0, {}, facts=by_plan)[0].verdict.reasons]
