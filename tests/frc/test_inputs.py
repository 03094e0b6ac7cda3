"""The hood's angle and the robot's velocity by their keys: what these may say, what they may not, and a real server."""

import math
import struct
import time
from typing import Any

import ntcore
import pytest
from hypothesis import given
from hypothesis import strategies as some
from msgspec import UNSET
from msgspec.structs import replace

from tests.frc.nt_server import Table, free_port
from tests.frc.test_advice import NS, Clock
from tests.robot.alike import codes
from tests.robot.encoders import NT4
from tests.robot.good_tick import NOW_NS, good_inputs, good_memory
from truearc.cli.common import SHIPPED
from truearc.hw.devices.family import FAILURE, Around
from truearc.hw.real.clock import MonotonicClock
from truearc.hw.real.processes import Slots
from truearc.robot import reasons as because
from truearc.robot.config.named_tables import encoder_family_of
from truearc.robot.config.schema import Config, load_config
from truearc.robot.tick import step
from truearc.robot.types import Command, Inputs, RobotVelocity, Sent
from truearc_frc import inputs as nt
from truearc_frc.keys import Reading
from truearc_frc.table import Nt4, Nt4Velocity, with_nt4

TABLE = NT4.hood_encoder


def said(value: float | str, t_ns: int = NOW_NS) -> Table:
    return Table({TABLE.key: Reading(t_ns, value)})


def test_a_key_in_turns_is_an_angle_with_the_stamp_of_its_publication() -> None:
    encoder = nt.NtEncoder(TABLE, said(0.125, 17))
    reading = encoder.read(NOW_NS)
    assert (reading.t_ns, reading.angle_rad, reading.magnet_ok) == (17, pytest.approx(math.radians(45.0)), True)
    assert encoder.faults(NOW_NS) == () and encoder.ids() == () and encoder.frames(NOW_NS) == ()
    degrees = nt.NtEncoder(replace(TABLE, unit="deg"), said(-30.0))
    assert degrees.read(NOW_NS).angle_rad == pytest.approx(math.radians(330.0))
    assert nt.NtEncoder(replace(TABLE, unit="rad"), said(1.0)).read(NOW_NS).angle_rad == pytest.approx(1.0)


@pytest.mark.parametrize("value", [math.nan, math.inf, 1.01, -2.0, "0.125"])
def test_what_is_not_an_angle_is_a_fault_and_no_reading(value: float | str) -> None:
    encoder = nt.NtEncoder(TABLE, said(value))
    assert encoder.read(NOW_NS) is None
    assert codes(encoder.faults(NOW_NS)) == [because.KEY_IMPLAUSIBLE.name]


def test_a_key_that_is_gone_and_a_server_that_is_gone_are_named() -> None:
    encoder = nt.NtEncoder(TABLE, Table(connected=False))
    assert encoder.read(NOW_NS) is None
    assert encoder.faults(NOW_NS) == (because.NT_LOST(), because.KEY_MISSING(key="/Hood/Rot"))


@pytest.mark.parametrize(("age_s", "off_deg", "code"), [
    (0.02, 0.0, None), (0.2, 0.0, because.DEVICE_STALE), (0.02, 4.0, because.HOOD_ENCODERS_DISAGREE)])
def test_a_key_that_freezes_or_jumps_is_a_hold(age_s: float, off_deg: float, code) -> None:
    truth_deg = good_memory().aim.hood_deg + off_deg
    encoder = nt.NtEncoder(TABLE, said((90.0 - truth_deg) / 360.0, NOW_NS - int(age_s * 1e9)))
    tick = step(replace(good_inputs(), hood_angle=encoder.read(NOW_NS)), good_memory(), NT4, None)
    assert tick.verdict.fire is (code is None)
    assert code is None or code.name in codes(tick.verdict.reasons)


def test_a_real_server_is_read_without_waiting_and_the_doctor_sees_what_it_publishes(nt_server):
    finding, = nt.examine(TABLE, Around(0.1, {"nt4": {"server": f"127.0.0.1:{free_port()}"}}), None)
    assert finding.level == FAILURE and "no connection" in finding.says
    server, address = nt_server
    table, around = TABLE, Around(0.1, {"nt4": {"server": address}})
    options = ntcore.PubSubOptions(keepDuplicates=True, sendAll=True, periodic=0.01)
    topic = server.getDoubleTopic(TABLE.key).publish(options)
    encoder = encoder_family_of(table).make(table, around)
    try:
        stamps, longest_s, until = [], 0.0, time.monotonic() + 20.0
        while len(stamps) < 4 and time.monotonic() < until:
            topic.set(0.125)
            began = time.monotonic()
            reading = encoder.read(time.monotonic_ns())
            longest_s = max(longest_s, time.monotonic() - began)
            if reading is not None:
                assert reading.angle_rad == pytest.approx(math.radians(45.0))
                stamps += [reading.t_ns] if not stamps or reading.t_ns - stamps[-1] > 1_000_000 else []
            time.sleep(0.02)
        assert len(stamps) >= 4 and encoder.faults(0) == ()
        assert all(abs(time.monotonic_ns() - t_ns) < 20e9 for t_ns in stamps) and longest_s < 0.5
        finding, = nt.examine(table, around, None)
        assert finding.level == FAILURE and "stands still" in finding.says
    finally:
        encoder._keys.close()


# --- velocity: into the robot's axes, none in doubt, through another process's memory

SHIPPED_CONFIG = load_config(SHIPPED)
AT_NS = 50 * NS
ROBOT = Nt4Velocity("/Drive/Speeds", 2.0, 2.0)
FIELD = Nt4Velocity("/Drive/Speeds", 2.0, 2.0, frame="field", heading="/Drive/Heading", heading_unit="deg",
                    alive="/Time")
speeds = some.floats(-6.0, 6.0)


def config(velocity: Nt4Velocity, server: str = "254") -> Config:
    return with_nt4(SHIPPED_CONFIG, Nt4(server, velocity=velocity))


def keys(forward: float, left: float, t_ns: int = AT_NS, **other: float) -> dict[str, Reading]:
    numbers = {"/Drive/Speeds/0": forward, "/Drive/Speeds/1": left, **{f"/Drive/{name}": value
                                                                       for name, value in other.items()}}
    return {key: Reading(t_ns, value) for key, value in numbers.items()} | {"/Time": Reading(AT_NS + 7, 1.0)}


@given(speeds, speeds, some.floats(-720.0, 720.0))
def test_a_velocity_of_the_field_is_turned_into_the_robots_axes(ahead: float, side: float, heading_deg: float) -> None:
    turn = complex(math.cos(math.radians(heading_deg)), math.sin(math.radians(heading_deg)))
    field = complex(ahead, side) * turn
    table = Table(keys(field.real, field.imag, Heading=heading_deg))
    read = nt.NtVelocity(config(FIELD), table, Clock()).read()
    assert read is not None and (read.forward_m_s, read.left_m_s) == pytest.approx((ahead, side), abs=1e-9)
    assert read.t_ns == AT_NS + 7                       # that of `alive`: a robot may stand still
    table.found = keys(ahead, side)
    assert nt.NtVelocity(config(ROBOT), table, Clock()).read() == RobotVelocity(AT_NS, ahead, side)


@pytest.mark.parametrize("key", nt.keys_of_velocity(FIELD))
@pytest.mark.parametrize("value", [None, math.nan, math.inf, "text"])
def test_a_key_that_is_missing_or_no_number_is_no_velocity(key: str, value: float | str | None) -> None:
    found = keys(1.0, 0.0, Heading=0.0)
    if value is None:
        del found[key]
    else:
        found[key] = Reading(AT_NS, value)
    assert nt.NtVelocity(config(FIELD), Table(found), Clock()).read() is None


def test_a_velocity_of_the_field_is_as_old_as_its_heading_and_with_alive_as_that() -> None:
    found = keys(1.0, 0.0, Heading=0.0) | {"/Drive/Heading": Reading(AT_NS - NS, 0.0)}
    alone = nt.NtVelocity(config(replace(FIELD, alive="")), Table(found), Clock()).read()
    assert alone is not None and alone.t_ns == AT_NS - NS
    standing = nt.NtVelocity(config(FIELD), Table(found), Clock()).read()
    assert standing is not None and standing.t_ns == AT_NS + 7


@pytest.mark.parametrize("alive", ["", "/Time"])
def test_a_heading_that_jumps_silences_it_and_one_that_turns_once_round_does_not(alive: str) -> None:
    table = Table({})
    velocity = nt.NtVelocity(config(replace(FIELD, alive=alive)), table, Clock())
    known = []
    for number in range(100):
        t_ns = AT_NS + number * 20_000_000
        heading = 170.0 + 5.0 * number - 360.0 * (number > 20) + 90.0 * (number >= 40)
        table.found = keys(0.0, 0.0, t_ns, Heading=heading) | {"/Time": Reading(t_ns, 1.0)}
        known.append(velocity.read() is not None)
    assert all(known[:40]) and not any(known[40:66]) and all(known[68:])


def test_a_jump_silences_it_for_half_a_second_and_a_lost_server_at_once() -> None:
    table = Table({})
    velocity = nt.NtVelocity(config(ROBOT), table, Clock())
    known = []
    for number in range(60):
        table.found = keys(3.5 if number == 20 else 1.0 + 0.01 * number, 0.0, AT_NS + number * 20_000_000)
        known.append(velocity.read() is not None)
    assert all(known[:20]) and not any(known[20:46]) and all(known[48:])
    table.connected = False
    assert velocity.read() is None


class Rig:
    def __init__(self, *inputs: Inputs | None) -> None:
        self.inputs = list(inputs)

    def read(self) -> Inputs | None:
        return self.inputs.pop(0)

    def write(self, command: Command) -> Sent:
        return Sent(False, False, False, 0.0, 0.0, 0.0)

    def picture(self) -> None:
        return None


def test_the_newest_velocity_reaches_the_inputs_and_none_leaves_none() -> None:
    memory = bytearray(nt.ROOM.bytes)
    said = iter([RobotVelocity(1, 1.0, 0.5), RobotVelocity(1, 1.0, 0.5), None, RobotVelocity(2, 0.0, 0.0)])
    rig = nt.MovingRig(Rig(*[good_inputs()] * 4, None), nt.FarVelocity(Slots(memory, nt.ROOM)))
    first = rig.read()
    assert first is not None and first.velocity is UNSET

    class Saying:
        def read(self) -> RobotVelocity | None:
            return next(said)

    told = []
    for count in (1, 2, 1):
        left = iter([False] * count + [True])
        nt.tell_velocity(Saying(), Slots(memory, nt.ROOM), lambda wait_s, left=left: next(left))  # type: ignore[misc]
        inputs = rig.read()
        assert inputs is not None
        told.append(inputs.velocity)
    assert told == [RobotVelocity(1, 1.0, 0.5), UNSET, RobotVelocity(2, 0.0, 0.0)]
    assert rig.read() is None


def test_chassis_speeds_on_a_real_server_are_read(nt_server: tuple[Any, str]) -> None:
    server, address = nt_server
    chassis = server.getRawTopic("/Drive/Speeds").publish("struct:ChassisSpeeds")
    velocity = nt.OwnNtVelocity(config(ROBOT, address), MonotonicClock())
    began, read = time.monotonic(), None
    while read is None and time.monotonic() - began < 10.0:
        chassis.set(struct.pack("<3d", 1.5, -0.25, 0.1 * time.monotonic()))
        server.flush()
        time.sleep(0.01)
        read = velocity.read()
    velocity.close()
    assert read is not None and (read.forward_m_s, read.left_m_s) == (1.5, -0.25)
    assert abs(read.t_ns - time.monotonic_ns()) < 1e9
