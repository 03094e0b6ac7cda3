"""What an ODrive axis's driver says of readings that cannot be, and that it lets go whatever they say."""

import struct

import pytest

from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.devices.odrive.family import OdriveMotor
from truearc.hw.devices.odrive.frames import OdriveAxis
from truearc.hw.protocols import Frame

MS = 1_000_000


# --- letting go

AXIS = OdriveAxis(1, 1)
LIMITS = odrive.make_limits(AXIS, 683.1, 66.0)
GO = [odrive.make_controller_mode(AXIS, odrive.TORQUE, odrive.PASSTHROUGH), LIMITS,
      odrive.make_state(AXIS, odrive.CLOSED_LOOP)]
LET_GO = [odrive.make_torque(AXIS, 0.0), odrive.make_state(AXIS, odrive.IDLE)]


def says(motor: OdriveMotor, t_ns: int, state: int, error: int = 0) -> None:
    motor.take(Frame(t_ns, 0x21, struct.pack("<IBBBB", error, state, 0, 0, 0)))


def order(motor: OdriveMotor, t_ns: int, torque_nm: float | None) -> list[Frame]:
    """What it sends in one tick, but for its question."""
    motor.faults(t_ns)
    return [frame for frame in motor.order(torque_nm, t_ns).frames if not frame.is_remote]


@pytest.fixture
def driven() -> OdriveMotor:
    """At 1 s, after 0.1 s of torque."""
    motor = OdriveMotor(AXIS, LIMITS)
    order(motor, 1, None)
    motor.take(Frame(1, 0x20, bytes(8)))
    assert order(motor, 900 * MS, 0.2) == [odrive.make_clear_errors(AXIS), *GO, odrive.make_torque(AXIS, 0.2)]
    says(motor, 901 * MS, odrive.CLOSED_LOOP)
    for t_ns in range(905 * MS, 1000 * MS, 5 * MS):
        assert set(order(motor, t_ns, 0.2)) <= {odrive.make_torque(AXIS, 0.2)}
    return motor


@pytest.mark.parametrize("state", [odrive.CLOSED_LOOP, odrive.IDLE, 0])
def test_a_release_is_said_in_its_first_tick_and_again_whatever_the_axis_says(driven: OdriveMotor, state: int) -> None:
    says(driven, 999 * MS, state)
    assert order(driven, 1000 * MS, None) == LET_GO
    again = {t_ns: frames for t_ns in range(1005 * MS, 1505 * MS, 5 * MS) if (frames := order(driven, t_ns, None))}
    assert list(again) == [at * MS for at in range(1100, 1505, 100)] and all(one == LET_GO for one in again.values())


def test_what_is_wanted_again_comes_up_at_once_though_it_says_that_it_is_up(driven: OdriveMotor) -> None:
    """Its heartbeat is older than the release."""
    assert order(driven, 1000 * MS, None) == LET_GO
    assert order(driven, 1005 * MS, 0.2) == [odrive.make_clear_errors(AXIS), *GO, odrive.make_torque(AXIS, 0.2)]
    assert order(driven, 1010 * MS, None) == LET_GO


def test_it_lets_go_by_itself_of_an_axis_whose_readings_come_too_late(driven: OdriveMotor) -> None:
    t_ns = 1000 * MS
    for _ in range(2):                                    # a long time is confirmed by a second answer
        while not driven._trip.is_open:
            assert order(driven, t_ns, 0.2) != LET_GO
            t_ns += 5 * MS
        for _ in range(30):
            order(driven, t_ns, 0.2)
            t_ns += 5 * MS
        driven.take(Frame(t_ns, 0x20, bytes(8)))
    assert order(driven, t_ns, 0.2) == LET_GO and driven.order(0.2, t_ns).torque_nm == 0.0
