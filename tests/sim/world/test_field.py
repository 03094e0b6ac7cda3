"""Where the robot stands and drives, what its camera sees, the goal, and a ball's flight to it."""

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from tests.sim.world.calm import CALM, calm
from truearc.hw.emulated.nodes import View
from truearc.robot.config import schema as config
from truearc.robot.config.schema import load_config
from truearc.sim.world.field import Chassis, Flight, classify
from truearc.sim.world.options import Options
from truearc.sim.world.scene import Ball, Released
from truearc.sim.world.world import World


def _drive(stand: Chassis, dt: float = 0.005) -> list[float]:
    places = [stand.distance_m]
    while stand.moving and len(places) < 5000:
        stand.step(dt)
        places.append(stand.distance_m)
    return places


@pytest.mark.parametrize("goal", [2.6, 3.99, 4.3, 8.0])
@pytest.mark.parametrize("dt", [0.005, 0.001])
def test_it_stops_where_it_was_sent_within_its_limits(goal: float, dt: float) -> None:
    stand = Chassis(1, 4.0, 1.0)
    stand.drive_to(goal)
    places = _drive(stand, dt)
    assert stand.distance_m == goal
    assert not stand.moving
    speeds = [(b - a) / dt for a, b in itertools.pairwise(places)]
    assert max(map(abs, speeds)) < 1.5 + 0.2
    assert min(places) >= min(4.0, goal) - 0.01
    assert max(places) <= max(4.0, goal) + 0.01
    ideal = abs(goal - 4.0) / 1.5
    assert len(places) * dt < ideal + 1.6


def test_it_parks_a_little_askew_and_points_at_the_target() -> None:
    stand = Chassis(3, 4.0, 1.0)
    seen = set()
    for goal in (3.0, 7.0, 5.0, 2.6, 8.0):
        stand.drive_to(goal)
        _drive(stand)
        pose = stand.pose()
        assert pose.x_m == -goal
        assert abs(pose.y_m) <= 0.3
        off = pose.heading_rad - math.atan2(-pose.y_m, goal)
        assert abs(math.degrees(off)) <= 0.3 + 1e-9
        seen.add(round(pose.y_m, 6))
    assert len(seen) == 5


def _inside_hexagon(y: float, up: float) -> bool:
    """By walking round the six corners of a regular hexagon that stands on a flat side, apothem 0.35."""
    circum = 0.35 / math.cos(math.radians(30.0))
    corners = [(circum * math.cos(math.radians(60.0 * k)), circum * math.sin(math.radians(60.0 * k))) for k in range(6)]
    return all((x2 - x1) * (up - z1) - (z2 - z1) * (y - x1) >= 0.0
               for (x1, z1), (x2, z2) in zip(corners, corners[1:] + corners[:1], strict=True))


@given(st.floats(-0.6, 0.6), st.floats(-0.6, 0.6).filter(lambda up: abs(up) > 1e-6))
def test_each_crossing_has_the_name_that_geometry_gives(y: float, up: float) -> None:
    outcome = classify(y, 2.44 + up)
    if math.hypot(y, up) < 0.0699:
        assert outcome == "three"
    elif math.hypot(y, up) > 0.0701 and _inside_hexagon(y * 1.0001, up * 1.0001):
        assert outcome == ("two" if abs(up) <= 0.07 else "two-high" if up > 0.0 else "two-low")
    elif not _inside_hexagon(y * 0.9999, up * 0.9999):
        assert outcome == ("miss-high" if up > 0.0 else "miss-low")


def project(view: View, point: tuple[float, float, float]) -> np.ndarray:
    return (view.camera_from_target @ np.array([*point, 1.0]))[:3]


@given(seed=st.integers(0, 1000), distance=st.floats(2.6, 8.0))
@settings(max_examples=30, deadline=None)
def test_the_view_is_rigid_and_the_lens_is_where_the_mounting_says(seed: int, distance: float) -> None:
    world = World(seed, Options(), distance)
    told = load_config(Path(config.__file__).parents[1] / "launcher.toml").camera
    transform = world.view().camera_from_target
    assert transform[:3, :3] @ transform[:3, :3].T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(transform[:3, :3]) == pytest.approx(1.0)
    lens = -transform[:3, :3].T @ transform[:3, 3]    # in target axes: right, up, towards the viewer
    pose = world.chassis.pose()
    assert lens[1] == pytest.approx(told.height_m - 2.27965)
    assert lens[2] == pytest.approx(distance + told.behind_exit_m * math.cos(pose.heading_rad))
    assert lens[0] == pytest.approx(-pose.y_m + told.behind_exit_m * math.sin(pose.heading_rad))


def test_a_robot_square_to_the_target_sees_it_upright_ahead_and_above() -> None:
    view = World(1, CALM, 5.0).view()
    centre, right, top = project(view, (0, 0, 0)), project(view, (0.3, 0, 0)), project(view, (0, 0.2, 0))
    assert centre[0] == pytest.approx(0.0, abs=1e-12)
    assert centre[2] > 0.0
    assert right[0] - centre[0] == pytest.approx(0.3)
    assert top[1] < centre[1]                         # y is down in the image
    pitch = math.degrees(math.atan2(-centre[1], centre[2])) + 24.0
    assert math.tan(math.radians(pitch)) == pytest.approx((2.27965 - 0.60) / 5.2)


def test_camera_options_reach_the_view() -> None:
    usual = World(1, CALM).view()
    assert (usual.focal_scale, usual.brightness) == (1.0, 1.0)
    odd = World(1, calm(camera_focal_scale=1.02, ring_light=0.4, camera_pitch_error_deg=1.0)).view()
    assert (odd.focal_scale, odd.brightness) == (1.02, 0.4)
    turned = odd.camera_from_target[:3, :3] @ usual.camera_from_target[:3, :3].T
    assert math.degrees(math.acos((np.trace(turned) - 1.0) / 2.0)) == pytest.approx(1.0, abs=1e-6)
    before, after = project(usual, (0, 0, 0)), project(odd, (0, 0, 0))
    assert after[1] / after[2] > before[1] / before[2]          # looking higher, the target sinks in the image
    lifted = World(1, calm(camera_height_m=0.8, camera_behind_exit_m=0.1, camera_pitch_deg=30.0)).view()
    lens = -lifted.camera_from_target[:3, :3].T @ lifted.camera_from_target[:3, 3]
    assert lens == pytest.approx([0.0, 0.8 - 2.27965, 4.1])


MASS, RADIUS, GRAVITY = 0.14, 0.0889, 9.81
BALL = Ball("b", MASS, RADIUS, 8000.0, 1.0, 1.0, 0.0, 0.0)
VACUUM = Options(air_density_kg_m3=0.0)
DISTANCE = 5.0


def _start(speed: float, deg: float, spin: tuple[float, float, float] = (0.0, 0.0, 0.0),
           distance: float = DISTANCE) -> Released:
    angle = math.radians(deg)
    return Released(np.array([-distance, 0.0, 0.75]), speed * np.array([math.cos(angle), 0.0, math.sin(angle)]),
                    np.array(spin))


def _fly(options: Options, start: Released, dt: float = 0.005) -> Flight:
    flight = Flight(BALL, options, start)
    while flight.arrival is None:
        flight.step(dt)
    return flight


def _reference(start: Released, cd: float, magnus: float, wind: tuple[float, float, float], until: float,
               spin_drag: float = 0.0) -> np.ndarray:
    """Drag 1/2 Cd rho pi r^2 |u| u and Magnus C rho 4/3 pi r^3 w x u on the velocity u through the air, by DOP853."""
    rho = 1.2
    area, volume, inertia = math.pi * RADIUS**2, 4.0 / 3.0 * math.pi * RADIUS**3, 0.4 * MASS * RADIUS**2

    def rate(_: float, state: np.ndarray) -> np.ndarray:
        through = state[3:6] - np.array(wind)
        spin = state[6:9]
        drag = (-0.5 * cd * rho * area * np.linalg.norm(through) - 6.0 * math.pi * 1.8e-5 * RADIUS) * through
        lift = magnus * rho * volume * np.cross(spin, through)
        second = 8.0 / 15.0 * math.pi * RADIUS**5                # MuJoCo's angular drag on a sphere
        slow = -(spin_drag * rho * second * np.linalg.norm(spin) + 8.0 * math.pi * 1.8e-5 * RADIUS**3) * spin / inertia
        return np.concatenate([state[3:6], (drag + lift) / MASS + np.array([0.0, 0.0, -GRAVITY]), slow])

    found = solve_ivp(rate, (0.0, until), np.concatenate(start), method="DOP853", rtol=1e-11, atol=1e-12)
    return found.y[:, -1]


@given(speed=st.floats(7.5, 15.0), deg=st.floats(15.0, 75.0))
@settings(max_examples=40, deadline=None)
def test_in_vacuum_a_ball_crosses_where_the_parabola_does(speed: float, deg: float) -> None:
    arrival = _fly(VACUUM, _start(speed, deg)).arrival
    after = DISTANCE / (speed * math.cos(math.radians(deg)))
    height = 0.75 + DISTANCE * math.tan(math.radians(deg)) - 0.5 * GRAVITY * after**2
    lands = (speed * math.sin(math.radians(deg))
             + math.sqrt((speed * math.sin(math.radians(deg)))**2 + 2.0 * GRAVITY * (0.75 - RADIUS))) / GRAVITY
    if arrival.z_m is None:
        assert height < RADIUS + 1e-6
        assert arrival.after_s == pytest.approx(lands, abs=1e-6)
    else:
        assert arrival.z_m == pytest.approx(height, abs=1e-7)
        assert arrival.after_s == pytest.approx(after, abs=1e-8)
        assert arrival.y_m == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("cd", "magnus", "wind"), [
    (0.5, 0.0, (0.0, 0.0, 0.0)), (0.0, 0.25, (0.0, 0.0, 0.0)), (0.5, 0.25, (0.0, 0.0, 0.0)),
    (0.9, -0.1, (0.0, 0.0, 0.0)), (0.5, 0.25, (-2.0, 1.0, 0.5))])
def test_the_fluid_forces_are_the_ones_that_are_stated(cd, magnus, wind):
    start = _start(12.0, 45.0, (3.0, -70.0, 8.0))
    options = Options(drag_coefficient=cd, magnus_coefficient=magnus, wind_x_m_s=wind[0], wind_y_m_s=wind[1],
                      wind_z_m_s=wind[2])
    flight = Flight(BALL, options, start)
    for _ in range(100):
        flight.step(0.005)
    expected = _reference(start, cd, magnus, wind, 0.5)
    assert flight.data.qpos[:3] == pytest.approx(expected[:3], abs=2e-6)
    assert flight.data.qvel[:3] == pytest.approx(expected[3:6], abs=1e-5)


def test_a_ball_that_turns_back_or_falls_short_never_crosses() -> None:
    for start in (_start(3.0, 45.0), _start(-3.0, 0.0)):
        arrival = _fly(Options(), start).arrival
        assert arrival is not None and arrival.z_m is None and arrival.y_m is None
