"""Balls of a rack, and a ball between the wheels."""

import math
import statistics

import mujoco
import numpy as np
import pytest

from truearc.sim.world import drive, scene
from truearc.sim.world.options import Options

CALM = Options(scatter_scale=0.0)
STIFFNESS = 8000.0
INERTIA = drive.LOWER_INERTIA_KG_M2 + drive.UPPER_GEAR**2 * drive.UPPER_INERTIA_KG_M2


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


def test_without_scatter_all_balls_are_as_drawn() -> None:
    rack = scene.Rack(3, CALM)
    balls = {rack.ball(k)._replace(ball_id="") for k in range(3 * scene.RACK)}
    assert len(balls) == 1
    assert balls.pop() == ("", 0.14, 0.0889, 8000.0, 1.0, 1.0, 0.0, 0.0)


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
    given = 0.5 * INERTIA * (wheel**2 - nip.wheel_rad_s**2) + torque * wheel * spent + 8.0 * 0.07   # and the feeder
    assert 0.2 * given < got < given


def test_gravity_acts_downwards_whatever_the_elevation() -> None:
    for elevation in (0.0, 30.0, 75.0):
        nip = scene.Nip(_ball(), Options(), math.radians(elevation), 0.0, 0.0)
        gravity = scene.rotate_from_launch(nip._model.opt.gravity, math.radians(elevation))
        assert gravity == pytest.approx([0.0, 0.0, -9.81], abs=1e-12)


def test_weak_wheels_throw_a_ball_back_or_hold_it() -> None:
    nip, feeder = scene.Nip(_ball(), Options(), math.radians(75.0), 0.0, 0.3), scene.Feeder()
    for _ in range(400):
        nip.step(0.0, feeder, 0.005)
        if nip.thrown_back:
            break
    assert nip.released is None
    assert nip.thrown_back or nip.x_m < 0.0
