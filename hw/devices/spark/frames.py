"""REV SPARK MAX and Flex frames for firmware 25 and 26: encoding of commands and decoding of replies, without I/O.

An arbitration id has 29 bits and is the id for device 0 plus the device number. On the wire, positions are in
revolutions of the motor shaft and speeds in revolutions per minute; here they are in radians and radians per second,
with the axis's `direction` applied.

Once a SPARK has received a heartbeat from a competition's robot controller, it obeys no other controller until it is
powered off (REV's CAN specification, STATUS_0's PRIMARY_HEARTBEAT_LOCK).
"""

import math
import struct
from collections.abc import Iterable
from types import MappingProxyType

from msgspec import Struct
from msgspec.structs import replace

from truearc.hw import fault_codes as codes
from truearc.hw.codec import Values, load_codec
from truearc.hw.devices.family import Bounds, CanNode, Direction, current_limit_a
from truearc.hw.fault_codes import FRAME_UNEXPECTED, PARAMETER_VALUE
from truearc.hw.protocols import AngleReading, BadFrame, ErrorTable, Frame, MotorReading, errors_in
from truearc.hw.reason import Reason

RPM_RAD_S = math.tau / 60.0
OLDEST_FIRMWARE, NEWEST_FIRMWARE = 25, 26         # before 25 the frames had other ids; after 26 untested
HEARTBEAT = "SECONDARY_HEARTBEAT"                    # one frame about all devices
HEARTBEAT_LOST_MS = 100                           # without a secondary heartbeat for this long the output is 0

# The device has no states of its own; these are what this house knows of it
UNKNOWN = 0                                       # not set up: nothing of it is to be believed
IDLE = 1
DRIVEN = 8                                        # set up, enabled, and applying what it is asked

# Bits of `axis_error`: the device's own faults, standing or sticky, and two things more
HAS_RESET = 0x100
LOCKED = 0x200
FAULTS = 0xFF
ERRORS: ErrorTable = (
    (0x01, codes.ERROR_OTHER), (0x02, codes.ERROR_MOTOR_TYPE), (0x04, codes.ERROR_SENSOR), (0x08, codes.ERROR_CAN),
    (0x10, codes.ERROR_OVER_TEMPERATURE), (0x20, codes.ERROR_GATE_DRIVER), (0x40, codes.ERROR_CONTROLLER_MEMORY),
    (0x80, codes.ERROR_FIRMWARE), (HAS_RESET, codes.ERROR_HAS_RESET), (LOCKED, codes.ERROR_LOCKED),
)
RESET_WARNING = 0x40                              # among STATUS_1's warnings

READINGS = ("STATUS_0", "STATUS_1", "STATUS_2")   # what becomes part of a MotorReading
STATUSES = 0b111                                  # the same as bits of SET_STATUSES_ENABLED
ENCODER_READINGS = ("STATUS_5", "STATUS_6")       # of an absolute encoder on the data port: angle, whether it signals
ENCODER_STATUSES = 0b1100000

# Parameters, by number
IDLE_MODE = 6                                     # of a motor that is not driven: 0 coasts, 1 brakes
FORWARD_LIMIT, REVERSE_LIMIT = 52, 53             # 1: the switch stops the motor
STALL_LIMIT, HIGHEST_A = 59, 80.0                 # A; a new device has the highest that its maker allows
AVERAGE_DEPTH, SAMPLE_DELTA = 70, 71              # of an encoder's speed: samples; 0.5 ms
HALL_PERIOD, HALL_DEPTH = 136, 137                # of a brushless motor's own sensor: s; samples
STATUS_2_PERIOD, STATUS_5_PERIOD = 160, 163       # ms
DUTY_FACTOR = 139                                 # STATUS_5's position is that many for one turn
PARAMETERS = (IDLE_MODE, FORWARD_LIMIT, REVERSE_LIMIT, STALL_LIMIT, AVERAGE_DEPTH, SAMPLE_DELTA, HALL_PERIOD,
              HALL_DEPTH, STATUS_2_PERIOD, STATUS_5_PERIOD, DUTY_FACTOR)
FLOATS = (HALL_PERIOD, DUTY_FACTOR)
# A new device smears speed over 0.1 s and says it every 20 ms: too late for a loop, and a ball's dip does not show.
QUICK_SPEED = MappingProxyType({AVERAGE_DEPTH: 1.0, SAMPLE_DELTA: 16.0, HALL_PERIOD: 0.008, HALL_DEPTH: 1.0,
                                STATUS_2_PERIOD: 10.0})


class SparkAxis(Struct, frozen=True):
    """One motor on the bus."""

    device: CanNode
    direction: Direction                          # device's sign that launches a ball or raises the hood
    has_endstop: bool = False                     # a limit switch ends its motion in the robot's negative direction


def errors_of(axis_error: int) -> tuple[Reason, ...]:
    """Return the errors of a reading's bit field; empty when it is healthy."""
    return errors_in(axis_error, ERRORS)


def name_of(axis: SparkAxis) -> str:
    """Return the device's name as used in messages."""
    return f"spark {axis.device}"


def settings(axis: SparkAxis, bounds: Bounds, torque_nm_a: float) -> dict[int, float]:
    """Return the parameters that truearc needs and sets after every reset. torque_nm_a: of the motor; 0: unknown."""
    limit = {REVERSE_LIMIT if axis.direction > 0 else FORWARD_LIMIT: 1.0} if axis.has_endstop else {}
    idle = {} if bounds.brakes is None else {IDLE_MODE: float(bounds.brakes)}
    current_a = current_limit_a(bounds, torque_nm_a)
    return {**QUICK_SPEED, **limit, **idle, **({} if current_a is None else {STALL_LIMIT: min(current_a, HIGHEST_A)})}


def frame_id(axis: SparkAxis, message: str) -> int:
    """Return the arbitration id (29 bits) of one of the device's messages; the heartbeat's is the same for all
    devices."""
    return load_codec("spark").base_id(message) + (0 if message == HEARTBEAT else axis.device)


def ids_sent_by(axis: SparkAxis, node: str) -> tuple[int, ...]:
    """Return the arbitration ids of all frames about this axis that the "Spark" or a "Host" sends, from the DBC
    file."""
    return tuple(frame_id(axis, message) for message in load_codec("spark").sent_by(node))


def frame_ids(axis: SparkAxis) -> tuple[int, ...]:
    """Return the arbitration ids of the frames that `parse` understands."""
    return tuple(frame_id(axis, message) for message in READINGS)


def make_duty(axis: SparkAxis, duty: float) -> Frame:
    """Apply this share of the bus voltage, -1 to 1, as long as heartbeats arrive. BadFrame if it is out of that
    range."""
    return make(axis, "DUTY_CYCLE_SETPOINT", {"duty": axis.direction * duty, "feedforward": 0, "slot": 0,
                                              "feedforward_is_duty": 0})


def make_heartbeat(devices: Iterable[int]) -> Frame:
    """Enable these devices and disable every other SPARK on the bus; to be sent by the tick, every 20 to 50 ms."""
    bits = sum(1 << device for device in set(devices))
    codec = load_codec("spark")
    data = codec.make(HEARTBEAT, {"devices_0_31": bits & 0xFFFFFFFF, "devices_32_63": bits >> 32})
    return Frame(0, codec.base_id(HEARTBEAT), data, is_extended=True)


def make_statuses(axis: SparkAxis, enabled: int) -> Frame:
    """Turn status frames on (bit n: STATUS_n) and leave the others as they are."""
    return make(axis, "SET_STATUSES_ENABLED", {"mask": enabled, "enabled": enabled})


def make_setting(axis: SparkAxis, parameter: int, value: float) -> Frame:
    """Set one of PARAMETERS until the next power-down; BadFrame if it does not fit."""
    return make(axis, "PARAMETER_WRITE", {"parameter": parameter, "value": setting_bits(parameter, value)})


def make_clear_faults(axis: SparkAxis) -> Frame:
    """Clear sticky faults and warnings, so that a later reset shows."""
    return make(axis, "CLEAR_FAULTS", {})


def make_version_query(axis: SparkAxis) -> Frame:
    """Query the firmware version, eight bytes; the answer has the same id, and `parse_version` accepts it."""
    return Frame(0, frame_id(axis, "GET_FIRMWARE_VERSION"), bytes(8), is_extended=True, is_remote=True)


def setting_bits(parameter: int, value: float) -> int:
    """Return a parameter's value as the 32 bits on the wire."""
    if parameter in FLOATS:
        return int.from_bytes(struct.pack("<f", value), "little")
    return int(value)


def setting_value(parameter: int, bits: int) -> float:
    """Return a parameter's value from 32 bits on the wire; BadFrame for a float that is not finite."""
    if parameter not in FLOATS:
        return float(bits)
    value = float(struct.unpack("<f", bits.to_bytes(4, "little"))[0])
    if not math.isfinite(value):
        raise BadFrame(PARAMETER_VALUE(parameter=parameter, value=value))
    return value


def parse(axis: SparkAxis, frame: Frame, previous: MotorReading) -> MotorReading:
    """Return `previous` updated by one frame; the caller sets `axis_state`, which depends on the commands sent.

    A remote frame changes nothing. BadFrame: wrong length, non-finite or implausible value, or an id that is not among
    `frame_ids(axis)`.
    """
    if frame.is_remote:
        return previous
    message = next((name for name in READINGS if frame_id(axis, name) == frame.arbitration_id), None)
    if message is None:
        raise BadFrame(_unexpected(axis, frame, *READINGS))
    values, sign, t_ns = _parse(axis, message, frame), axis.direction, frame.t_ns
    if message == "STATUS_2":
        return replace(previous, t_ns=t_ns, position_rad=sign * math.tau * values["position_rev"],
                       velocity_rad_s=sign * RPM_RAD_S * values["velocity_rpm"])
    if message == "STATUS_1":
        # Sticky ones too: what came and went since they were last cleared is to be looked at before anything moves.
        reset = HAS_RESET if int(values["sticky_warnings"]) & RESET_WARNING else 0
        errors = int(values["faults"]) | int(values["sticky_faults"]) | reset
        return replace(previous, axis_error=previous.axis_error & LOCKED | errors, errors_t_ns=t_ns)
    return _with_status_0(axis, values, t_ns, previous)


def parse_angle(axis: SparkAxis, frame: Frame, previous: AngleReading | None) -> AngleReading | None:
    """Return `previous` updated by one frame of an encoder on the data port; None until the first angle.

    The angle is the device's, in [0, 2 pi). A fault of 1 is an encoder without a signal. Raises as `parse`.
    """
    if frame.arbitration_id == frame_id(axis, "STATUS_6"):
        lost = int(_parse(axis, "STATUS_6", frame)["no_signal"])
        return previous and replace(previous, faults=lost, faults_t_ns=frame.t_ns, magnet_ok=not lost)
    turns = _parse(axis, "STATUS_5", frame)["position_rev"]
    known = previous or AngleReading(0, 0.0, False, 0, 0)
    return replace(known, t_ns=frame.t_ns, angle_rad=math.tau * (turns % 1.0), magnet_ok=not known.faults)


def parse_applied(axis: SparkAxis, frame: Frame) -> float:
    """Return the applied duty from a STATUS_0 frame, with the robot's sign."""
    return axis.direction * _parse(axis, "STATUS_0", frame)["applied_duty"]


def parse_version(axis: SparkAxis, frame: Frame) -> tuple[int, int, int]:
    """Return the device's firmware version (major, minor, build)."""
    values = _parse(axis, "GET_FIRMWARE_VERSION", frame)
    return int(values["major"]), int(values["minor"]), int(values["build"])


def parse_statuses(axis: SparkAxis, frame: Frame) -> int:
    """Parse an answer to `make_statuses`; bit n: STATUS_n is on. 0 if it was refused."""
    values = _parse(axis, "SET_STATUSES_ENABLED_RESPONSE", frame)
    return 0 if values["result"] else int(values["enabled"])


def parse_setting(axis: SparkAxis, frame: Frame) -> tuple[int, float] | None:
    """Parse an answer to `make_setting`: the parameter and its value; None: refused, or a parameter that is never
    set."""
    values = _parse(axis, "PARAMETER_WRITE_RESPONSE", frame)
    parameter = int(values["parameter"])
    if parameter not in PARAMETERS or values["result"]:
        return None
    return parameter, setting_value(parameter, int(values["value"]))


def _with_status_0(axis: SparkAxis, values: Values, t_ns: int, previous: MotorReading) -> MotorReading:
    # The current comes without a sign. Driving, it is that of the duty; an axis that is braked by its duty says less.
    current_a = math.copysign(values["current_a"], axis.direction * values["applied_duty"])
    error = previous.axis_error & ~LOCKED | (LOCKED if values["primary_heartbeat_lock"] else 0)
    reading = replace(previous, heartbeat_t_ns=t_ns, axis_error=error, current_t_ns=t_ns, current_a=current_a,
                      bus_t_ns=t_ns, bus_v=values["bus_v"], errors_t_ns=previous.errors_t_ns or 0)
    if not axis.has_endstop:
        return reading
    closed = values["hard_reverse" if axis.direction > 0 else "hard_forward"]
    return replace(reading, endstop_t_ns=t_ns, endstop=closed == 1)


def make(axis: SparkAxis, message: str, values: Values) -> Frame:
    """Return one of the messages about this axis, whichever node of the DBC file sends it."""
    return Frame(0, frame_id(axis, message), load_codec("spark").make(message, values), is_extended=True)


def _parse(axis: SparkAxis, message: str, frame: Frame) -> dict[str, float]:
    if frame.arbitration_id != frame_id(axis, message) or frame.is_remote:
        raise BadFrame(_unexpected(axis, frame, message))
    return load_codec("spark").parse_frame(message, frame, name_of(axis))


def _unexpected(axis: SparkAxis, frame: Frame, *wanted: str) -> Reason:
    return FRAME_UNEXPECTED(device=name_of(axis), frame=frame.name, wanted=wanted)


# --- a competition's robot controller

CONTROLLER_HEARTBEAT = 0x01011840
DEVICES = 0x3F


def is_controller_heartbeat(frame: Frame) -> bool:
    """Return whether this is the heartbeat of a robot controller (roboRIO, Systemcore)."""
    return frame.is_extended and frame.arbitration_id == CONTROLLER_HEARTBEAT


def locked_spark(frame: Frame) -> int | None:
    """Return the number of the SPARK that reports a lock to a robot controller here; None for any other frame."""
    device = SparkAxis(frame.arbitration_id & DEVICES, 1, False)
    if not frame.is_extended or frame.arbitration_id != frame_id(device, "STATUS_0"):
        return None
    try:
        reading = parse(device, frame, MotorReading())
    except BadFrame:
        return None
    return device.device if reading.axis_error & LOCKED else None
