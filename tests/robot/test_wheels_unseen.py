"""Wheels whose encoders show no motion although they turn, or that do not turn, under loops that are soft or tuned."""

import pytest
from msgspec.structs import replace

from tests.robot.alike import codes
from tests.robot.test_motion import AIMED, SET_RAD_S, Launcher, latched, released_after_s, wheels
from truearc.hw.devices.odrive.frames import IDLE
from truearc.robot import reasons as because
from truearc.robot.config.schema import Config
from truearc.robot.types import Inputs, Memory

ZERO = wheels(velocity_rad_s=0.0, position_rad=0.0)


def as_it_is(inputs: Inputs) -> Inputs:
    return inputs


def armed_again(launcher: Launcher, times: int) -> list[str]:
    """Disarm and arm as a driver does who sees wheels that do not turn; what the verdict says at the end."""
    for _ in range(times):
        launcher.arm()
        launcher.run(0.6)
        launcher.arm()
        launcher.run(0.3)
    launcher.arm()
    launcher.run(0.6)
    return latched(launcher)


def test_arming_again_and_again_does_not_speed_up_wheels_whose_encoders_are_dead() -> None:
    launcher = Launcher()
    launcher.spoil = ZERO
    assert armed_again(launcher, 6) == [because.WHEELS_GIVEN_UP.name]
    assert launcher.wheel_rad_s <= 1.15 * SET_RAD_S


def test_wheels_that_turn_in_between_are_not_given_up() -> None:
    memory, t_s = Memory(), 10.0
    for spoil in (ZERO, as_it_is, ZERO, as_it_is, ZERO, ZERO):
        launcher = Launcher()
        launcher.memory, launcher.t_s, launcher.spoil = memory, t_s, spoil
        launcher.arm(0.1)
        launcher.run(0.6)
        assert latched(launcher) == ([because.JOINT_NOT_TURNING.name] if spoil is ZERO else [])
        launcher.arm()
        launcher.run(0.1)
        memory, t_s = launcher.memory, launcher.t_s
    assert memory.wheel_failures == 2


@pytest.mark.parametrize(("ks_nm", "kp"), [(0.0, 0.0015), (-0.01, 0.0015), (0.25, 0.001), (0.3, 0.001)])
def test_soft_loops_are_released_too_from_wheels_that_do_not_turn(ks_nm: float, kp: float) -> None:
    wheel = AIMED.flywheel
    config: Config = replace(AIMED, flywheel=replace(wheel, ks_nm=ks_nm, pid=replace(wheel.pid, kp=kp, ki=0.0)))
    launcher = Launcher(config)
    launcher.spoil = ZERO
    launcher.arm(0.1)
    launcher.run(0.05)
    assert released_after_s(launcher, "flywheel") <= 0.5
    assert latched(launcher) == [because.JOINT_NOT_TURNING.name]
    if ks_nm <= 0.0:                  # the others' feed-forward takes sound wheels beyond their set point
        sound = Launcher(config)
        sound.arm(0.1)
        sound.run(3.0)
        assert latched(sound) == [] and sound.wheel_rad_s > 100.0


def test_the_feeder_stops_where_the_wheels_come_into_doubt() -> None:
    launcher = Launcher()
    launcher.arm(0.1)
    launcher.run(3.0)
    launcher.press = "fire"
    while not launcher.ticks[-1].command.feeder_torque_nm:
        launcher.run(0.005)
    launcher.spoil = wheels(axis_state=IDLE)
    tick = launcher.run(0.02)
    assert because.MOTOR_NOT_DRIVEN.name in codes(tick.verdict.reasons)
    assert tick.command.feeder_torque_nm == 0.0
