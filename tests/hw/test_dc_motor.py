"""Torque to duty and back: what a data sheet says of a motor at its two ends, and everything in between."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from truearc.hw.devices.drivers import DcMotor, duty_for, torque_of

MOTOR = DcMotor(2.6, 594.0, 12.0)
volts = st.floats(6.0, 15.0)


def test_the_ends_of_the_data_sheet() -> None:
    assert torque_of(MOTOR, 1.0, 0.0, 12.0) == pytest.approx(2.6)       # stalled
    assert torque_of(MOTOR, 1.0, 594.0, 12.0) == pytest.approx(0.0)     # free
    assert torque_of(MOTOR, 0.5, 0.0, 12.0) == pytest.approx(1.3)
    assert duty_for(MOTOR, 0.0, 297.0, 12.0) == pytest.approx(0.5)      # coasting: only the back-EMF is met


def test_a_flat_battery_needs_more_duty() -> None:
    assert duty_for(MOTOR, 0.65, 0.0, 6.0) == pytest.approx(2.0 * duty_for(MOTOR, 0.65, 0.0, 12.0))


@given(torque=st.floats(-5.0, 5.0), speed=st.floats(-900.0, 900.0), bus_v=volts)
def test_the_torque_is_met_or_the_duty_is_at_its_end(torque: float, speed: float, bus_v: float) -> None:
    duty = duty_for(MOTOR, torque, speed, bus_v)
    got = torque_of(MOTOR, duty, speed, bus_v)
    if abs(duty) < 1.0:
        assert got == pytest.approx(torque, abs=1e-12)
    else:
        assert abs(duty) == 1.0 and (torque - got) * duty >= -1e-12    # as much as there is, and never too much
