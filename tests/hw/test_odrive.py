"""ODrive frames against the public facts and somebody else's DBC file; its driver lets go whatever readings say."""

import math
import struct

import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.hw.dbc_facts import is_float, length, limits
from truearc.hw import fault_codes as hw
from truearc.hw.codec import load_codec
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.devices.odrive.family import OdriveMotor
from truearc.hw.devices.odrive.frames import OdriveAxis
from truearc.hw.protocols import BadFrame, Frame, MotorReading

TURN = 2.0 * math.pi
nodes = st.integers(0, 62)
axes = st.builds(OdriveAxis, nodes, st.sampled_from((-1, 1)), st.integers(1, 65535))
torques = st.floats(-50.0, 50.0, width=32)


def frame(axis: OdriveAxis, command: int, data: bytes, t_ns: int = 7) -> Frame:
    return Frame(t_ns, axis.node << 5 | command, data)


@given(axis=axes, torque=torques)
def test_torque_bytes(axis: OdriveAxis, torque: float) -> None:
    sent = odrive.make_torque(axis, torque)
    assert sent.arbitration_id == axis.node * 32 + 0x0E and not sent.is_extended and not sent.is_remote
    assert sent.data == struct.pack("<fI", axis.direction * torque, 0)


def test_command_bytes() -> None:
    axis = OdriveAxis(3, -1, 596)
    assert odrive.make_state(axis, odrive.CLOSED_LOOP)[1:3] == (0x67, bytes([8, 0, 0, 0, 0, 0, 0, 0]))
    assert odrive.make_controller_mode(axis, odrive.TORQUE, odrive.PASSTHROUGH).data == struct.pack("<II", 1, 1)
    assert odrive.make_clear_errors(axis)[1:3] == (0x78, b"\0")
    assert odrive.make_estop(axis)[1:3] == (0x62, b"")
    assert odrive.make_endstop_query(axis)[1:3] == (0x64, bytes([0, 0x54, 0x02, 0, 0, 0, 0, 0]))
    assert odrive.make_version_query(axis) == Frame(0, 0x60, b"", is_remote=True)


@given(axis=axes, position=st.floats(-1e5, 1e5, width=32), velocity=st.floats(-500.0, 500.0, width=32))
def test_encoder_estimates_become_radians_in_the_robots_sign(axis, position, velocity):
    reading = odrive.parse(axis, frame(axis, 0x09, struct.pack("<ff", position, velocity)), MotorReading())
    assert reading.t_ns == 7
    assert reading.position_rad == pytest.approx(axis.direction * TURN * position)
    assert reading.velocity_rad_s == pytest.approx(axis.direction * TURN * velocity)


def test_each_group_has_its_own_stamp_and_leaves_the_others_alone() -> None:
    axis, reading = OdriveAxis(2, -1, 596), MotorReading()
    reading = odrive.parse(axis, frame(axis, 0x01, bytes([0, 0, 0, 1, 8, 0, 1, 0]), 11), reading)
    reading = odrive.parse(axis, frame(axis, 0x14, struct.pack("<ff", 5.0, 4.5), 12), reading)
    reading = odrive.parse(axis, frame(axis, 0x17, struct.pack("<ff", 12.5, 3.0), 13), reading)
    reading = odrive.parse(axis, frame(axis, 0x05, bytes([0, 0x54, 0x02, 0, 1, 0, 0, 0]), 14), reading)
    assert reading == MotorReading(heartbeat_t_ns=11, axis_state=8, axis_error=0x01000000, current_t_ns=12,
                                   current_a=-4.5, bus_t_ns=13, bus_v=12.5, endstop_t_ns=14, endstop=True)
    assert odrive.errors_of(reading.axis_error) == (hw.ERROR_WATCHDOG_EXPIRED(),)


def test_answers_and_foreign_frames() -> None:
    axis, closed = OdriveAxis(2, 1, 596), MotorReading(endstop_t_ns=1, endstop=True)
    assert not odrive.parse(axis, frame(axis, 0x05, bytes([0, 0x54, 0x02, 0, 0])), closed).endstop
    assert odrive.parse(axis, frame(axis, 0x05, bytes([0, 0x55, 0x02, 0, 0])), closed) == closed
    with pytest.raises(BadFrame, match="limit switch"):
        odrive.parse(axis, frame(axis, 0x05, bytes([0, 0x54, 0x02, 0, 2])), closed)
    axis = OdriveAxis(2, 1)
    reading = odrive.parse(axis, frame(axis, 0x03, struct.pack("<II", 0x200, 0x02000000)), MotorReading())
    assert odrive.errors_of(reading.axis_error) == (hw.ERROR_DC_BUS_UNDER_VOLTAGE(), hw.ERROR_ESTOP_REQUESTED())
    assert odrive.errors_of(0x80000000) == (hw.ERROR_BITS(bits=0x80000000),)
    assert odrive.errors_of(0) == ()
    axis = OdriveAxis(2, 1)
    version = odrive.parse_version(axis, frame(axis, 0x00, bytes([2, 5, 2, 0, 0, 6, 10, 0])))
    assert version == (0, 6, 10)
    with pytest.raises(BadFrame):
        odrive.parse_version(axis, frame(axis, 0x01, bytes(8)))
    axis, reading = OdriveAxis(2, 1), MotorReading(t_ns=3)
    with pytest.raises(BadFrame, match="0x069"):
        odrive.parse(axis, Frame(1, 0x69, bytes(8)), reading)
    assert odrive.parse(axis, Frame(1, 0x49, b"", is_remote=True), reading) == reading


@pytest.mark.parametrize("data", [b"", bytes(7), bytes(9), struct.pack("<ff", math.nan, 0.0),
                                  struct.pack("<ff", 0.0, math.inf), struct.pack("<ff", 0.0, 9000.0)])
def test_malformed_encoder_frames_are_refused_by_name(data: bytes) -> None:
    axis = OdriveAxis(2, 1)
    with pytest.raises(BadFrame, match=r"node 2, id 0x049: odrive Get_Encoder_Estimates: .*, expected") as refused:
        odrive.parse(axis, frame(axis, 0x09, data), MotorReading())
    assert refused.value.reason.code == ("frame_length" if len(data) != 8 else "frame_value")
    assert refused.value.reason.params["bytes"] == len(data)


# Ours -> theirs (0.6.10), signal by signal
THEIRS = {
    "Get_Version": {"protocol": "Protocol_Version", "hardware_line": "Hw_Version_Major",
                    "hardware_version": "Hw_Version_Minor", "hardware_variant": "Hw_Version_Variant",
                    "firmware_major": "Fw_Version_Major", "firmware_minor": "Fw_Version_Minor",
                    "firmware_revision": "Fw_Version_Revision", "firmware_unreleased": "Fw_Version_Unreleased"},
    "Heartbeat": {"axis_error": "Axis_Error", "axis_state": "Axis_State", "procedure_result": "Procedure_Result",
                  "trajectory_done": "Trajectory_Done_Flag"},
    "Estop": {},
    "Get_Error": {"active_errors": "Active_Errors", "disarm_reason": "Disarm_Reason"},
    "RxSdo": {"opcode": "Opcode", "endpoint": "Endpoint_ID", "value": "Value"},
    "TxSdo": {"endpoint": "Endpoint_ID", "value": "Value"},
    "Address": {"node": "Node_ID", "serial": "Serial_Number"},
    "Set_Axis_State": {"axis_state": "Axis_Requested_State"},
    "Get_Encoder_Estimates": {"position_rev": "Pos_Estimate", "velocity_rev_s": "Vel_Estimate"},
    "Set_Controller_Mode": {"control_mode": "Control_Mode", "input_mode": "Input_Mode"},
    "Set_Input_Vel": {"velocity_rev_s": "Input_Vel", "torque_nm": "Input_Torque_FF"},
    "Set_Input_Torque": {"torque_nm": "Input_Torque"},
    "Set_Limits": {"velocity_rev_s": "Velocity_Limit", "current_a": "Current_Limit"},
    "Get_Iq": {"setpoint_a": "Iq_Setpoint", "measured_a": "Iq_Measured"},
    "Get_Temperature": {"inverter_degc": "FET_Temperature", "motor_degc": "Motor_Temperature"},
    "Get_Bus_Voltage_Current": {"bus_v": "Bus_Voltage", "bus_a": "Bus_Current"},
    "Clear_Errors": {"identify": "Identify"}}
RESERVED = {"RxSdo": {"Reserved": 0}, "TxSdo": {"Reserved0": 0, "Reserved1": 0}}


@pytest.fixture(scope="module")
def theirs(data_dir) -> cantools.database.Database:
    return cantools.database.load_file(data_dir / "dbc" / "odrive-cansimple-0.6.10.dbc", strict=False)


@pytest.mark.data
@pytest.mark.parametrize("name", sorted(THEIRS))
@given(data=st.data())
def test_bytes_agree_with_the_makers_dbc(theirs, name: str, data: st.DataObject) -> None:
    codec, message = load_codec("odrive"), theirs.get_message_by_name(f"Axis0_{name}")
    assert (codec.base_id(name), length(codec, name)) == (message.frame_id, message.length)
    values = {ours: data.draw(_values(codec, name, ours)) for ours in THEIRS[name]}
    renamed = {THEIRS[name][ours]: value for ours, value in values.items()} | RESERVED.get(name, {})
    ours_bytes = codec.make(name, values)
    assert message.decode(ours_bytes, decode_choices=False) == renamed
    assert message.encode(renamed, strict=False) == ours_bytes
    assert codec.parse(name, message.encode(renamed, strict=False)) == values


def _values(codec, name: str, signal: str) -> st.SearchStrategy:
    low, high = limits(codec, name)[signal]
    if is_float(codec, name, signal):
        return st.floats(low, high, width=32)
    return st.integers(int(low), int(high))


@pytest.mark.data
@given(axis=st.builds(OdriveAxis, st.integers(0, 7), st.sampled_from((-1, 1))), torque=torques)
def test_what_the_driver_sends_reads_there_as_meant(theirs, axis: OdriveAxis, torque: float) -> None:
    def read(sent: Frame) -> dict[str, float]:
        message = theirs.get_message_by_frame_id(sent.arbitration_id)
        assert message.name.startswith(f"Axis{axis.node}_")
        return message.decode(sent.data, decode_choices=False)

    assert read(odrive.make_torque(axis, torque)) == {"Input_Torque": axis.direction * torque}
    assert read(odrive.make_state(axis, odrive.CLOSED_LOOP)) == {"Axis_Requested_State": 8}
    assert read(odrive.make_controller_mode(axis, odrive.TORQUE, odrive.PASSTHROUGH)) == {
        "Control_Mode": 1, "Input_Mode": 1}


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
