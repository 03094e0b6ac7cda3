"""What an ODrive axis's driver says of readings that cannot be."""

import struct

import pytest

from truearc.hw.devices.odrive.frames import OdriveAxis
from truearc.hw.devices.odrive.motor import OdriveMotor
from truearc.hw.encoder_plausibility import MOVING_RAD_S
from truearc.hw.fault_codes import ENCODER_STUCK
from truearc.hw.protocols import Frame

MS = 1_000_000
FAST_REV_S = 20.0


def feed(motor: OdriveMotor, t_ns: int, position_rev: float, velocity_rev_s: float) -> None:
    motor.take(Frame(t_ns, 0x29, struct.pack("<ff", position_rev, velocity_rev_s)))


@pytest.fixture
def motor() -> OdriveMotor:
    motor = OdriveMotor(OdriveAxis(1, 1))
    motor.faults(1)
    motor.order(None, 1)                                  # asks, and is answered at once
    motor.take(Frame(1, 0x20, bytes(8)))
    return motor


def test_an_encoder_that_claims_to_turn_and_stands_still_is_named(motor: OdriveMotor) -> None:
    for tick in range(1, 5):
        feed(motor, tick * 10 * MS, 0.2 * tick, FAST_REV_S)
    assert motor.faults(40 * MS) == ()
    for tick in range(5, 9):
        feed(motor, tick * 10 * MS, 0.8, FAST_REV_S)
    assert motor.faults(85 * MS) == ()                    # 40 ms: it may have been a frame that came twice
    feed(motor, 90 * MS, 0.8, FAST_REV_S)
    (fault,) = motor.faults(95 * MS)
    assert fault == ENCODER_STUCK(controller="odrive node 1", speed_rad_s=motor.reading.velocity_rad_s)
    feed(motor, 100 * MS, 2.0, FAST_REV_S)
    assert motor.faults(100 * MS) == ()


def test_one_that_stands_still_and_says_so_is_not(motor: OdriveMotor) -> None:
    slow = 0.9 * MOVING_RAD_S / 6.2832
    for tick in range(1, 50):
        feed(motor, tick * 10 * MS, 1.0, slow)
    assert motor.faults(500 * MS) == ()


def test_every_frame_twice_is_no_stuck_encoder(motor: OdriveMotor) -> None:
    for tick in range(1, 50):
        for moment in (0, 1):
            feed(motor, tick * 10 * MS + moment * MS, 0.2 * tick, FAST_REV_S)
            assert motor.faults(tick * 10 * MS + moment * MS) == ()
