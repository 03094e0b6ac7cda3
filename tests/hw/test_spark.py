"""SPARK frames against the public facts, written by hand, and against a DBC file made from the maker's table."""

import math
import struct

import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.hw.dbc_facts import length
from truearc.hw import fault_codes as hw
from truearc.hw.codec import load_codec
from truearc.hw.devices.spark import frames as spark
from truearc.hw.devices.spark.frames import SparkAxis
from truearc.hw.protocols import BadFrame, Frame, MotorReading

TURN = 2.0 * math.pi
signs = st.sampled_from((-1, 1))
axes = st.builds(SparkAxis, st.integers(0, 62), signs, st.booleans())


def frame(base_id: int, axis: SparkAxis, data: bytes, t_ns: int = 7) -> Frame:
    return Frame(t_ns, base_id + axis.device, data, is_extended=True)


@given(axis=axes, duty=st.floats(-1.0, 1.0, width=32))
def test_duty_bytes(axis: SparkAxis, duty: float) -> None:
    sent = spark.make_duty(axis, duty)
    assert sent == Frame(0, 0x02050080 + axis.device, struct.pack("<fI", axis.direction * duty, 0), True)


def test_command_bytes() -> None:
    axis = SparkAxis(5, 1)
    assert spark.make_statuses(axis, 0b111)[1:3] == (0x02050405, bytes([7, 0, 7, 0]))
    assert spark.make_clear_faults(axis)[1:3] == (0x02051B85, b"")
    assert spark.make_version_query(axis)[1:] == (0x02052605, bytes(8), True, True)
    assert spark.make_setting(axis, 71, 16.0)[1:3] == (0x02053805, bytes([71, 16, 0, 0, 0]))
    assert spark.make_setting(axis, 136, 0.008)[1:3] == (0x02053805, bytes([136]) + struct.pack("<f", 0.008))


@given(devices=st.sets(st.integers(0, 62)))
def test_a_heartbeat_is_a_bit_for_each_device(devices: set[int]) -> None:
    sent = spark.make_heartbeat(devices)
    assert (sent.arbitration_id, sent.is_extended) == (0x02052C80, True)
    bits = int.from_bytes(sent.data, "little")
    assert len(sent.data) == 8 and {bit for bit in range(64) if bits >> bit & 1} == devices


def test_status_frames_written_by_hand() -> None:
    heard = Frame(7, 0x0205B805, bytes.fromhex("5D3F662622230000"), True)       # half the bus's 12 V, 20 A, 35 degrees
    reading = spark.parse(SparkAxis(5, 1, True), heard, MotorReading())
    assert (reading.current_a, reading.bus_v) == (pytest.approx(20.0, abs=0.02), pytest.approx(12.0, abs=0.004))
    assert (reading.heartbeat_t_ns, reading.current_t_ns, reading.bus_t_ns, reading.endstop_t_ns) == (7, 7, 7, 7)
    assert (reading.t_ns, reading.axis_error, reading.endstop) == (0, 0, False)
    assert spark.parse(SparkAxis(5, -1), heard, MotorReading()).current_a == -reading.current_a
    assert spark.parse_applied(SparkAxis(5, -1), heard) == pytest.approx(-0.5, abs=2e-5)
    axis, reading = SparkAxis(5, 1), MotorReading()
    reading = spark.parse(axis, frame(0x0205B840, axis, bytes([0x10, 0, 0, 0x08, 0, 0x40, 0, 0])), reading)
    reading = spark.parse(axis, frame(0x0205B800, axis, bytes([0, 0, 0, 0, 0, 0, 0x20, 0])), reading)
    assert spark.errors_of(reading.axis_error) == (hw.ERROR_CAN(), hw.ERROR_OVER_TEMPERATURE(), hw.ERROR_HAS_RESET(),
                                                   hw.ERROR_LOCKED())
    reading = spark.parse(axis, frame(0x0205B840, axis, bytes(8)), reading)
    assert reading.axis_error == spark.LOCKED
    assert spark.parse(axis, frame(0x0205B800, axis, bytes(8)), reading).axis_error == 0


@pytest.mark.parametrize(("direction", "bit", "closed"), [(1, 0x02, True), (1, 0x01, False), (-1, 0x01, True),
                                                           (-1, 0x02, False), (1, 0x0C, False)])
def test_the_switch_is_the_one_that_ends_the_negative_direction(direction: int, bit: int, closed: bool) -> None:
    heard = frame(0x0205B800, SparkAxis(5, direction), bytes([0, 0, 0, 0, 0, 0, bit, 0]))
    assert spark.parse(SparkAxis(5, direction, True), heard, MotorReading()).endstop is closed
    assert spark.parse(SparkAxis(5, direction), heard, MotorReading()).endstop_t_ns == 0      # none is wired


@pytest.mark.parametrize(("data", "error"), [
    (bytes([0, 0, 0xFF, 0, 0, 0xBF, 0, 0]), 0), (bytes([0, 0, 0, 0, 0, 0x40, 0, 0]), spark.HAS_RESET), (bytes(8), 0),
    (bytes([0, 0xFF, 0, 0, 0xFF, 0, 1, 0]), 0), (bytes([0x20, 0, 0, 0, 0, 0, 0, 0]), 0x20)])
def test_of_the_warnings_only_a_reset_is_an_error(data: bytes, error: int) -> None:
    """It is the sticky one that counts: that is what clearing faults clears."""
    axis = SparkAxis(5, 1)
    assert spark.parse(axis, frame(0x0205B840, axis, data), MotorReading()).axis_error == error


@given(axis=axes, rpm=st.floats(-1e4, 1e4, width=32), turns=st.floats(-1e5, 1e5, width=32))
def test_speeds_and_turns_become_radians_in_the_robots_sign(axis: SparkAxis, rpm: float, turns: float) -> None:
    reading = spark.parse(axis, frame(0x0205B880, axis, struct.pack("<ff", rpm, turns)), MotorReading())
    assert reading.t_ns == 7
    assert reading.velocity_rad_s == pytest.approx(axis.direction * TURN * rpm / 60.0)
    assert reading.position_rad == pytest.approx(axis.direction * TURN * turns)


@given(turns=st.floats(-1.0, 1.0, width=32), lost=st.booleans())
def test_an_encoder_on_the_data_port_tells_its_angle_and_whether_it_signals(turns: float, lost: bool) -> None:
    axis = SparkAxis(5, 1)
    heard = frame(0x0205B940, axis, struct.pack("<ff", 12.0, turns))
    reading = spark.parse_angle(axis, heard, None)
    assert (reading.t_ns, reading.magnet_ok, reading.faults_t_ns) == (7, True, 0)
    assert math.cos(reading.angle_rad - TURN * turns) == pytest.approx(1.0) and 0.0 <= reading.angle_rad <= TURN
    signal = frame(0x0205B980, axis, struct.pack("<HHI", 30_000, 1025, int(lost)), 9)
    said = spark.parse_angle(axis, signal, reading)
    assert (said.t_ns, said.faults_t_ns, said.faults, said.magnet_ok) == (7, 9, int(lost), not lost)
    assert spark.parse_angle(axis, heard, said).magnet_ok is not lost       # until the next report
    assert spark.parse_angle(axis, signal, None) is None


@pytest.mark.parametrize("turns", [1.5, -1.01, math.nan, math.inf, 90.0])
def test_an_angle_that_is_not_a_share_of_a_turn_is_refused(turns: float) -> None:
    axis = SparkAxis(5, 1)
    with pytest.raises(BadFrame, match=r"spark 5, id 0x0205b945: spark STATUS_5: .*position_rev"):
        spark.parse_angle(axis, frame(0x0205B940, axis, struct.pack("<ff", 0.0, turns)), None)


def test_answers_and_foreign_frames() -> None:
    axis = SparkAxis(5, 1)
    assert spark.parse_version(axis, frame(0x02052600, axis, bytes([25, 1, 0x01, 0x02, 0, 0, 0, 0]))) == (25, 1, 258)
    assert spark.parse_statuses(axis, frame(0x02050440, axis, bytes([0, 7, 0, 7, 0]))) == 7
    assert spark.parse_statuses(axis, frame(0x02050440, axis, bytes([1, 7, 0, 3, 0]))) == 0
    assert spark.parse_setting(axis, frame(0x02053840, axis, bytes([71, 2, 16, 0, 0, 0, 0]))) == (71, 16.0)
    refused = bytes([136, 3]) + struct.pack("<f", 0.03125) + b"\x02"
    assert spark.parse_setting(axis, frame(0x02053840, axis, refused)) is None
    assert spark.parse_setting(axis, frame(0x02053840, axis, bytes([200, 2, 16, 0, 0, 0, 0]))) is None
    with pytest.raises(BadFrame, match="parameter 136"):
        spark.parse_setting(axis, frame(0x02053840, axis, bytes([136, 3]) + struct.pack("<f", math.nan) + b"\0"))
    axis, reading = SparkAxis(5, 1), MotorReading(t_ns=3)
    with pytest.raises(BadFrame, match="0x0205b886"):
        spark.parse(axis, Frame(1, 0x0205B886, bytes(8), True), reading)
    assert spark.parse(axis, Frame(1, 0x0205B885, b"", True, is_remote=True), reading) == reading
    with pytest.raises(BadFrame, match="GET_FIRMWARE_VERSION"):
        spark.parse_version(axis, Frame(1, 0x0205B885, bytes(8), True))


# Ours -> theirs (2.1.0), signal by signal; of STATUS_1 theirs has a signal for every bit of ours
THEIRS = {
    "STATUS_0": {"applied_duty": "APPLIED_OUTPUT", "bus_v": "VOLTAGE", "current_a": "CURRENT",
                 "motor_degc": "MOTOR_TEMPERATURE", "hard_forward": "HARD_FORWARD_LIMIT_REACHED",
                 "hard_reverse": "HARD_REVERSE_LIMIT_REACHED", "soft_forward": "SOFT_FORWARD_LIMIT_REACHED",
                 "soft_reverse": "SOFT_REVERSE_LIMIT_REACHED", "inverted": "INVERTED",
                 "primary_heartbeat_lock": "PRIMARY_HEARTBEAT_LOCK", "model": "SPARK_MODEL"},
    "STATUS_2": {"velocity_rpm": "PRIMARY_ENCODER_VELOCITY", "position_rev": "PRIMARY_ENCODER_POSITION"},
    "STATUS_5": {"velocity_rpm": "DUTY_CYCLE_ENCODER_VELOCITY", "position_rev": "DUTY_CYCLE_ENCODER_POSITION"},
    "STATUS_6": {"raw_duty": "UNADJUSTED_DUTY_CYCLE", "period_us": "DUTY_CYCLE_PERIOD",
                 "no_signal": "DUTY_CYCLE_NO_SIGNAL"},
    "UNIQUE_ID_BROADCAST": {"unique_id": "UNIQUE_ID"},
    "VELOCITY_SETPOINT": {"velocity_rpm": "SETPOINT", "feedforward": "ARBITRARY_FEEDFORWARD", "slot": "PID_SLOT",
                          "feedforward_is_duty": "ARBITRARY_FEEDFORWARD_UNITS"},
    "DUTY_CYCLE_SETPOINT": {"duty": "SETPOINT", "feedforward": "ARBITRARY_FEEDFORWARD", "slot": "PID_SLOT",
                            "feedforward_is_duty": "ARBITRARY_FEEDFORWARD_UNITS"},
    "SET_STATUSES_ENABLED": {"mask": "MASK", "enabled": "ENABLED_BITFIELD"},
    "SET_STATUSES_ENABLED_RESPONSE": {"result": "RESULT_CODE", "mask": "SPECIFIED_MASK", "enabled": "ENABLED_BITFIELD"},
    "CLEAR_FAULTS": {}}
BITS = {"faults": ("OTHER_FAULT", "MOTOR_TYPE_FAULT", "SENSOR_FAULT", "CAN_FAULT", "TEMPERATURE_FAULT", "DRV_FAULT",
                   "ESC_EEPROM_FAULT", "FIRMWARE_FAULT"),
        "warnings": ("BROWNOUT_WARNING", "OVERCURRENT_WARNING", "ESC_EEPROM_WARNING", "EXT_EEPROM_WARNING",
                     "SENSOR_WARNING", "STALL_WARNING", "HAS_RESET_WARNING", "OTHER_WARNING")}
@pytest.fixture(scope="module")
def theirs(data_dir) -> cantools.database.Database:
    return cantools.database.load_file(data_dir / "dbc" / "rev_spark_2.1.0_generated.dbc", strict=False)


@pytest.mark.data
@pytest.mark.parametrize("name", sorted(THEIRS))
@given(data=st.data())
def test_bytes_agree_with_the_makers_table(theirs, name: str, data: st.DataObject) -> None:
    codec, message = load_codec("spark"), theirs.get_message_by_name(name)
    assert (codec.base_id(name), length(codec, name)) == (message.frame_id, message.length)
    heard = data.draw(st.binary(min_size=message.length, max_size=message.length))
    try:
        values = codec.parse(name, heard)
    except BadFrame:
        return
    said = message.decode(heard, decode_choices=False)
    assert values == {ours: pytest.approx(said[name_there]) for ours, name_there in THEIRS[name].items()}


@pytest.mark.data
@given(heard=st.binary(min_size=8, max_size=8))
def test_faults_are_their_bits(theirs, heard: bytes) -> None:
    said = theirs.get_message_by_name("STATUS_1").decode(heard, decode_choices=False)
    values = load_codec("spark").parse("STATUS_1", heard)
    for ours, names in BITS.items():
        assert values[ours] == sum(said[name] << bit for bit, name in enumerate(names))
        sticky = [name.replace("_FAULT", "_STICKY_FAULT").replace("_WARNING", "_STICKY_WARNING") for name in names]
        assert values[f"sticky_{ours}"] == sum(said[name] << bit for bit, name in enumerate(sticky))


@given(axis=axes, parameter=st.sampled_from(spark.PARAMETERS), data=st.data())
def test_a_setting_comes_back_as_it_went_out(axis: SparkAxis, parameter: int, data: st.DataObject) -> None:
    value = data.draw(st.floats(-1e6, 1e6, width=32) if parameter in spark.FLOATS else st.integers(0, 2**32 - 1))
    sent = spark.make_setting(axis, parameter, value)
    answer = Frame(1, sent.arbitration_id + 0x40, sent.data[:1] + b"\x02" + sent.data[1:] + b"\0", True)
    assert spark.parse_setting(axis, answer) == (parameter, value)
