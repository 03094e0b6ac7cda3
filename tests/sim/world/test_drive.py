"""Shafts, motors, battery and hood against an integrator; balls of a rack, and a ball between the wheels."""

import math
import statistics
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from truearc.robot.config import schema as config
from truearc.robot.config.schema import load_config
from truearc.sim.world import drive, scene
from truearc.sim.world.options import Options

INERTIA, VISCOUS, COULOMB = 6e-5, 1.5e-4, 0.02


def _integrated(speed: float, torque: float, dt: float) -> tuple[float, float]:
    """The same shaft by DOP853, switched where it stops."""
    def rate(_: float, state: np.ndarray) -> list[float]:
        return [(torque - direction * COULOMB - VISCOUS * state[0]) / INERTIA, state[0]]

    def stops(_: float, state: np.ndarray) -> float:
        return state[0]
    stops.terminal = True
    direction = np.sign(speed) if speed else np.sign(torque)
    if speed == 0.0:
        if abs(torque) <= COULOMB:
            return 0.0, 0.0
        found = solve_ivp(rate, (0.0, dt), [0.0, 0.0], method="DOP853", rtol=1e-11, atol=1e-13)
        return found.y[0, -1], found.y[1, -1]
    found = solve_ivp(rate, (0.0, dt), [speed, 0.0], method="DOP853", rtol=1e-11, atol=1e-13, events=stops)
    if found.t_events[0].size == 0:
        return found.y[0, -1], found.y[1, -1]
    after = _integrated(0.0, torque, dt - found.t[-1])
    return after[0], found.y[1, -1] + after[1]


@given(speed=st.one_of(st.just(0.0), st.floats(0.01, 500.0), st.floats(-500.0, -0.01)),
       torque=st.floats(-0.5, 0.5), dt=st.floats(1e-4, 0.1))
def test_a_shaft_turns_as_an_integrator_says(speed: float, torque: float, dt: float) -> None:
    turned = drive.step_shaft(speed, torque, dt, INERTIA, VISCOUS, COULOMB)
    expected = _integrated(speed, torque, dt)
    assert turned[0] == pytest.approx(expected[0], rel=1e-6, abs=1e-5)
    assert turned[1] == pytest.approx(expected[1], rel=1e-6, abs=1e-7)


def test_the_motor_follows_its_data_sheet_at_twelve_volt() -> None:
    for speed, bus_v, torque_nm in ((0.0, 12.0, 2.6), (594.0, 12.0, 0.0), (297.0, 12.0, 1.3),
                                    (594.0 * 11.0 / 12.0, 11.0, 0.0)):
        found = drive.drive_motor(drive.FLYWHEEL, 99.0, speed, bus_v, 1e4).torque_nm
        assert found == pytest.approx(torque_nm, abs=1e-12)


@given(asked=st.floats(-3.0, 3.0), speed=st.floats(-700.0, 700.0), bus=st.floats(6.0, 14.0))
def test_the_driver_gives_no_more_than_asked_nor_than_its_limit(asked: float, speed: float, bus: float) -> None:
    drawn = drive.drive_motor(drive.FLYWHEEL, asked, speed, bus, 40.0)
    assert abs(drawn.torque_nm) <= abs(asked) + 1e-12
    assert drawn.torque_nm * asked >= 0.0
    assert abs(drawn.current_a) <= 40.0 + 1e-9
    heat = drawn.current_a**2 * drive.FLYWHEEL.resistance_ohm
    assert drawn.power_w == pytest.approx(max(0.0, drawn.torque_nm * speed + heat), abs=1e-9)


def test_the_bus_sits_where_power_balances() -> None:
    supply = drive.Battery(Options(battery_start_v=12.6, battery_resistance_ohm=0.03))
    supply.draw(600.0, 0.005)
    current = (12.6 - supply.bus_v) / 0.03
    assert supply.bus_v * current == pytest.approx(600.0 + drive.STANDING_W)
    assert supply.bus_v > 6.3                         # the efficient one of the two solutions


def test_the_charge_runs_down_with_the_current() -> None:
    supply = drive.Battery(Options(battery_resistance_ohm=0.0))
    for _ in range(1000):
        supply.draw(1000.0, 0.1)
    amperes = 1020.0 / 12.6                           # nearly constant; 100 s of it out of 18 Ah, 1.2 V in all
    assert 12.6 - supply.open_circuit_v == pytest.approx(1.2 * amperes * 100.0 / 64800.0, rel=0.02)


DT = 0.005


def _run(hood: drive.Hood, torque: float, seconds: float) -> float:
    """Push until `seconds` are over; the time at which the hood last moved."""
    moved = 0.0
    for tick in range(round(seconds / DT)):
        before = hood.elevation_deg
        hood.step(torque, DT)
        if hood.elevation_deg != before:
            moved = (tick + 1) * DT
    return moved


@given(st.floats(15.0, 75.0))
def test_the_screw_is_as_long_as_the_triangle_drawn_in_the_plane(elevation: float) -> None:
    motor = np.array([0.30, 0.0])
    angle = math.radians(30.0 + elevation)
    nut = 0.25 * np.array([math.cos(angle), math.sin(angle)])
    turns = np.linalg.norm(motor - nut) / 0.005
    assert drive.screw_rad(elevation) == pytest.approx(2.0 * math.pi * turns, rel=1e-12)
    assert drive.elevation_deg(drive.screw_rad(elevation)) == pytest.approx(elevation, abs=1e-9)


def test_the_linkage_is_the_one_that_the_robot_is_told_of() -> None:
    told = load_config(Path(config.__file__).parents[1] / "launcher.toml").hood
    assert (told.pivot_to_motor_m, told.pivot_to_nut_m, told.included_deg, told.screw_lead_m) == (0.30, 0.25, 30.0,
                                                                                                  drive.LEAD_M)
    assert (told.low_deg, told.high_deg, told.screw_gear) == (15.0, 75.0, 1.0)


def test_the_stops_hold_and_the_switch_closes_near_the_lower_one() -> None:
    hood = drive.Hood(40.0, Options())
    assert not hood.at_limit
    _run(hood, -0.1, 4.0)
    assert hood.at_limit
    assert 15.0 <= hood.elevation_deg <= 15.1
    below = hood.position_rad
    _run(hood, -0.3, 1.0)
    assert hood.position_rad == below
    _run(hood, 0.3, 4.0)
    assert 74.9 <= hood.elevation_deg <= 75.0
    assert not hood.at_limit


def test_below_its_friction_nothing_moves() -> None:
    hood = drive.Hood(50.0, Options())
    _run(hood, 0.99 * drive.HOOD_COULOMB_NM, 1.0)
    assert (hood.elevation_deg, hood.position_rad) == (50.0, 0.0)


@pytest.mark.parametrize("play_deg", [0.0, 0.1, 0.8])
def test_reversing_loses_the_play(play_deg: float) -> None:
    hood = drive.Hood(50.0, Options(hood_backlash_deg=play_deg))
    _run(hood, 0.1, 0.3)
    _run(hood, 0.0, 1.0)
    top_deg, top_rad = hood.elevation_deg, hood.position_rad
    assert drive.elevation_deg(drive.screw_rad(50.0) + top_rad) - top_deg == pytest.approx(play_deg / 2.0, abs=1e-9)
    _run(hood, -0.1, 0.3)
    _run(hood, 0.0, 1.0)
    nut_deg = drive.elevation_deg(drive.screw_rad(50.0) + hood.position_rad)
    assert hood.elevation_deg - nut_deg == pytest.approx(play_deg / 2.0, abs=1e-9)


def test_a_crooked_magnet_changes_only_what_the_encoder_says() -> None:
    straight, crooked = drive.Hood(50.0, Options()), drive.Hood(50.0, Options(hood_offset_deg=1.5))
    for hood in (straight, crooked):
        _run(hood, 0.1, 0.2)
    assert crooked.elevation_deg == straight.elevation_deg
    assert math.degrees(crooked.encoder_rad - straight.encoder_rad) == pytest.approx(1.5)
    assert math.degrees(straight.encoder_rad) == pytest.approx(straight.elevation_deg)


STIFFNESS = 8000.0
BELT = drive.LOWER_INERTIA_KG_M2 + drive.UPPER_GEAR**2 * drive.UPPER_INERTIA_KG_M2


def test_every_ball_comes_once_before_any_comes_again() -> None:
    rack = scene.Rack(3, Options())
    for round_ in range(4):
        ids = [rack.ball(round_ * scene.RACK + k).ball_id for k in range(scene.RACK)]
        assert len(set(ids)) == scene.RACK
    assert ids != [rack.ball(k).ball_id for k in range(scene.RACK)]


def test_one_ball_keeps_its_mass_but_not_its_seat() -> None:
    rack = scene.Rack(3, Options())
    balls = [rack.ball(k) for k in range(10 * scene.RACK)]
    mine = [ball for ball in balls if ball.ball_id == "ball05"]
    assert len(mine) == 10
    assert len({ball.mass_kg for ball in mine}) == 1
    assert len({ball.seat_m for ball in mine}) == 10


@pytest.mark.parametrize(("scale", "least", "most"), [(1.0, 0.8, 1.2), (2.0, 1.6, 2.4)])
def test_the_scatter_is_as_wide_as_it_says(scale: float, least: float, most: float) -> None:
    options = Options(scatter_scale=scale)
    balls = [scene.Rack(seed, options).ball(k) for seed in range(40) for k in range(scene.RACK)]
    assert least < statistics.stdev(ball.mass_kg / 0.14 for ball in balls) / scene.MASS_SHARE < most
    assert least < statistics.stdev(ball.stiffness_n_m / 8000.0 for ball in balls) / scene.STIFFNESS_SHARE < most
    assert least < statistics.stdev(ball.seat_m for ball in balls) / scene.SEAT_M < most


def test_wear_is_counted_for_each_ball() -> None:
    rack = scene.Rack(3, Options(scatter_scale=0.0, wear_stiffness_per_shot=0.05, wear_radius_per_shot=0.001,
                           wear_friction_per_shot=0.02))
    mine, other = rack.ball(0).ball_id, rack.ball(1).ball_id
    rack.use(0)
    again = [ball for ball in (rack.ball(k) for k in range(scene.RACK, 3 * scene.RACK)) if ball.ball_id == mine]
    assert [ball.stiffness_n_m for ball in again] == pytest.approx([0.95 * 8000.0] * 2)
    assert [ball.radius_m for ball in again] == pytest.approx([0.999 * 0.0889] * 2)
    assert [ball.friction_scale for ball in again] == pytest.approx([0.98] * 2)
    assert all(ball.stiffness_n_m == 8000.0 for ball in (rack.ball(k) for k in range(scene.RACK, 2 * scene.RACK))
               if ball.ball_id == other)


def test_scales_and_warmth_multiply() -> None:
    ball = scene.Rack(3, Options(scatter_scale=0.0, ball_mass_scale=1.1, ball_radius_scale=0.98,
                                 ball_stiffness_scale=0.5, ball_friction_scale=0.8, temperature_c=30.0)).ball(0)
    assert (ball.mass_kg, ball.radius_m, ball.friction_scale) == pytest.approx((0.154, 0.087122, 0.8))
    assert ball.stiffness_n_m == pytest.approx(8000.0 * 0.5 * 0.9)


def _ball(**changes: float) -> scene.Ball:
    return scene.Ball("b", 0.14, 0.0889, STIFFNESS, 1.0, 1.0, 0.0, 0.0)._replace(**changes)


def _shoot(wheel: float, ball: scene.Ball | None = None, elevation_deg: float = 45.0, torque: float = 0.0,
           options: Options | None = None, step_s: float = scene.NIP_STEP_S) -> tuple[scene.Nip, float]:
    nip = scene.Nip(ball or _ball(), options or Options(), math.radians(elevation_deg), wheel, 1.1, step_s)
    feeder, spent = scene.Feeder(), 0.0
    while nip.released is None and spent < 0.5:
        spent += 0.005 - nip.step(torque, feeder, 0.005)
    assert nip.released is not None
    return nip, spent


def _summary(nip: scene.Nip, wheel: float) -> tuple[float, float, float, float]:
    """Speed over the ideal, droop, spin over no-slip, exit angle in degrees."""
    velocity = nip.released.velocity_m_s
    ideal = wheel * (0.0508 + 0.5625 * 0.0349) / 2.0
    no_slip = wheel * (0.0508 - 0.5625 * 0.0349) / (2.0 * 0.0889)
    return (float(np.linalg.norm(velocity)) / ideal, 1.0 - nip.wheel_rad_s / wheel,
            -float(nip.released.spin_rad_s[1]) / no_slip, math.degrees(math.atan2(velocity[2], velocity[0])))


@pytest.mark.parametrize("stiffness", [4000.0, 8000.0, 16000.0])
def test_a_squeezed_ball_pushes_back_with_its_stiffness(stiffness: float) -> None:
    model = scene.make_nip(_ball(stiffness_n_m=stiffness), Options(), np.zeros(3), np.zeros(3))
    data, force = mujoco.MjData(model), np.zeros(6)
    mujoco.mj_forward(model, data)                    # the ball at rest, midway between resting wheels
    assert data.ncon == 2
    for contact in range(2):
        mujoco.mj_contactForce(model, data, contact, force)
        assert force[0] == pytest.approx(stiffness * scene.COMPRESSION_M / 2.0, rel=0.02)


@pytest.mark.parametrize("wheel", [240.0, 330.0, 420.0, 510.0, 570.0])
def test_launches_are_like_those_of_real_machines(wheel: float) -> None:
    ratio, droop, spin, angle = _summary(_shoot(wheel)[0], wheel)
    assert 0.67 < ratio < 0.87                        # what one team measured on its machine
    assert 0.05 < droop < 0.13
    assert 0.75 < spin < 0.95
    assert -1.0 < angle < 4.0


@pytest.mark.parametrize("wheel", [250.0, 400.0, 550.0])
@pytest.mark.parametrize("torque", [0.0, 1.5])
def test_a_ball_gets_no_more_energy_than_the_wheels_and_the_motors_give(wheel: float, torque: float) -> None:
    nip, spent = _shoot(wheel, torque=torque, elevation_deg=0.0)
    velocity, spin = nip.released.velocity_m_s, nip.released.spin_rad_s
    got = 0.5 * 0.14 * (velocity @ velocity - 1.1**2) + 0.5 * 0.4 * 0.14 * 0.0889**2 * (spin @ spin)
    given = 0.5 * BELT * (wheel**2 - nip.wheel_rad_s**2) + torque * wheel * spent + 8.0 * 0.07   # and the feeder
    assert 0.2 * given < got < given


def test_weak_wheels_throw_a_ball_back_or_hold_it() -> None:
    nip, feeder = scene.Nip(_ball(), Options(), math.radians(75.0), 0.0, 0.3), scene.Feeder()
    for _ in range(400):
        nip.step(0.0, feeder, 0.005)
        if nip.thrown_back:
            break
    assert nip.released is None
    assert nip.thrown_back or nip.x_m < 0.0
