"""Somebody else's motor is heard and never spoken to."""

import struct
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from truearc.hw.devices.drivers import HeardMotor
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.devices.spark import frames as spark
from truearc.hw.fault_codes import ENCODER_STUCK
from truearc.hw.protocols import Frame

THEIRS = spark.SparkAxis(7, 1, has_endstop=True)


def heard() -> HeardMotor:
    return HeardMotor("its controller", spark.frame_ids(THEIRS), True, partial(spark.parse, THEIRS))


@given(ticks=st.lists(st.tuples(st.one_of(st.none(), st.floats(-10.0, 10.0)), st.binary(min_size=8, max_size=8))))
def test_nothing_that_is_asked_or_heard_makes_it_send(ticks) -> None:
    motor = heard()
    for number, (torque_nm, data) in enumerate(ticks):
        motor.take(Frame(number, 0x0205B847, data, True))
        order = motor.order(torque_nm, number * 5_000_000)
        assert order.frames == () and order.torque_nm == 0.0 and order.duty is None
    assert motor.release() == () and motor.faults(0) == ()


def test_a_speed_without_a_change_of_position_is_a_stuck_encoder() -> None:
    motor = heard()
    for number in range(1, 7):
        assert motor.faults(0) == ()
        motor.take(Frame(number * 10_000_000, 0x0205B887, struct.pack("<ff", 1200.0, 5.0), True))
    (fault,) = motor.faults(0)
    assert fault.code == ENCODER_STUCK.name and fault.params["controller"] == "its controller"
    assert fault.params["speed_rad_s"] == pytest.approx(125.7, abs=0.1)
    motor.take(Frame(90_000_000, 0x0205B887, struct.pack("<ff", 1200.0, 5.2), True))
    assert motor.faults(0) == ()


def test_it_hears_what_its_family_says() -> None:
    motor = heard()
    assert motor.ids() == ((0x0205B807, True), (0x0205B847, True), (0x0205B887, True))
    motor.take(Frame(9, 0x0205B807, bytes.fromhex("5D3F662622230200"), True))
    assert motor.reading.heartbeat_t_ns == 9 and motor.reading.endstop
    assert motor.reading.errors_t_ns == 0         # it has said nothing of them, and that is asked
    motor.take(Frame(10, 0x0205B847, bytes(8), True))
    motor.take(Frame(11, 0x0205B807, bytes.fromhex("5D3F662622230200"), True))
    assert (motor.reading.heartbeat_t_ns, motor.reading.errors_t_ns) == (11, 10)
    theirs = odrive.OdriveAxis(2, 1)
    other = HeardMotor("its controller", odrive.frame_ids(theirs), False, partial(odrive.parse, theirs))
    other.take(Frame(9, 0x41, bytes([0, 0, 0, 0, 8, 0, 0, 0])))
    assert other.reading.axis_state == odrive.CLOSED_LOOP
