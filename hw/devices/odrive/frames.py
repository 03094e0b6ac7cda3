"""ODrive CANSimple frames for firmware 0.6: encoding of commands and decoding of replies, without I/O.

An arbitration id has 11 bits and is `node << 5 | command`. On the wire, positions are in revolutions of the motor
shaft; here they are in radians with the axis's `direction` applied: positive launches a ball or raises the hood.
"""

import math
import struct
from types import MappingProxyType

from msgspec import Struct
from msgspec.structs import replace

from truearc.hw import fault_codes as codes
from truearc.hw.codec import Values, load_codec
from truearc.hw.devices.family import CanNode, Direction, TorquePerAmp
from truearc.hw.fault_codes import ENDSTOP_VALUE, FRAME_UNEXPECTED
from truearc.hw.protocols import BadFrame, ErrorTable, Frame, MotorReading, errors_in
from truearc.hw.reason import Reason

# Axis states
IDLE = 1
CLOSED_LOOP = 8

# Controller modes
TORQUE = 1
VELOCITY = 2
POSITION = 3
PASSTHROUGH = 1

# Error bits that this house acts on by name
WATCHDOG_EXPIRED = 0x01000000
ESTOP_REQUESTED = 0x02000000
VELOCITY_LIMIT = 0x00008000
ERRORS: ErrorTable = (
    (0x00000001, codes.ERROR_INITIALIZING), (0x00000002, codes.ERROR_SYSTEM_LEVEL), (0x00000004, codes.ERROR_TIMING),
    (0x00000008, codes.ERROR_MISSING_ESTIMATE), (0x00000010, codes.ERROR_BAD_CONFIG),
    (0x00000020, codes.ERROR_GATE_DRIVER), (0x00000040, codes.ERROR_MISSING_INPUT),
    (0x00000100, codes.ERROR_DC_BUS_OVER_VOLTAGE), (0x00000200, codes.ERROR_DC_BUS_UNDER_VOLTAGE),
    (0x00000400, codes.ERROR_DC_BUS_OVER_CURRENT), (0x00000800, codes.ERROR_DC_BUS_OVER_REGEN_CURRENT),
    (0x00001000, codes.ERROR_CURRENT_LIMIT), (0x00002000, codes.ERROR_MOTOR_OVER_TEMPERATURE),
    (0x00004000, codes.ERROR_INVERTER_OVER_TEMPERATURE), (VELOCITY_LIMIT, codes.ERROR_VELOCITY_LIMIT),
    (0x00010000, codes.ERROR_POSITION_LIMIT), (WATCHDOG_EXPIRED, codes.ERROR_WATCHDOG_EXPIRED),
    (ESTOP_REQUESTED, codes.ERROR_ESTOP_REQUESTED), (0x04000000, codes.ERROR_SPINOUT),
    (0x08000000, codes.ERROR_BRAKE_RESISTOR_DISARMED), (0x10000000, codes.ERROR_THERMISTOR_DISCONNECTED),
    (0x40000000, codes.ERROR_CALIBRATION),
)

SDO_READ, SDO_WRITE = 0, 1
HIGHEST_REV_S, HIGHEST_A = 5000.0, 2000.0         # of limits, as the DBC file has it
# Command -> message, of what becomes part of a MotorReading
READINGS = MappingProxyType({
    0x01: "Heartbeat", 0x03: "Get_Error", 0x05: "TxSdo", 0x09: "Get_Encoder_Estimates",
    0x14: "Get_Iq", 0x17: "Get_Bus_Voltage_Current",
})


class OdriveAxis(Struct, frozen=True):
    """One motor on the bus."""

    node: CanNode
    direction: Direction                          # device's sign that launches a ball or raises the hood
    endstop_endpoint: int = 0                     # SDO endpoint that reads the limit switch; 0 = none
    torque_nm_a: TorquePerAmp = 0.0               # its torque_constant; 0: not known


def errors_of(axis_error: int) -> tuple[Reason, ...]:
    """Return the errors of a reading's bit field; empty when it is healthy."""
    return errors_in(axis_error, ERRORS)


def name_of(axis: OdriveAxis) -> str:
    """Return the device's name as used in messages."""
    return f"odrive node {axis.node}"


def frame_ids(axis: OdriveAxis) -> tuple[int, ...]:
    """Return the arbitration ids (11 bits) of the frames that `parse` understands."""
    return tuple(axis.node << 5 | command for command in READINGS)


def frame_id(axis: OdriveAxis, message: str) -> int:
    """Return the arbitration id (11 bits) of one of the axis's messages."""
    return axis.node << 5 | load_codec("odrive").base_id(message)


def ids_sent_by(axis: OdriveAxis, node: str) -> tuple[int, ...]:
    """Return the arbitration ids of all frames about this axis that the "Axis" or a "Host" sends, from the DBC file."""
    return tuple(frame_id(axis, message) for message in load_codec("odrive").sent_by(node))


def make_torque(axis: OdriveAxis, torque_nm: float) -> Frame:
    """Request a torque at the motor shaft, which also feeds the device's watchdog. BadFrame if it is not finite."""
    return make(axis, "Set_Input_Torque", {"torque_nm": axis.direction * torque_nm})


def make_state(axis: OdriveAxis, state: int) -> Frame:
    """Request an axis state: IDLE, CLOSED_LOOP, ..."""
    return make(axis, "Set_Axis_State", {"axis_state": state})


def make_controller_mode(axis: OdriveAxis, control: int, input_mode: int) -> Frame:
    """Set what the device controls (TORQUE, ...) and how it treats its input (PASSTHROUGH, ...)."""
    return make(axis, "Set_Controller_Mode", {"control_mode": control, "input_mode": input_mode})


def make_limits(axis: OdriveAxis, speed_rad_s: float, current_a: float) -> Frame:
    """Set the device's own limits until it restarts: beyond the speed it gives no torque, beyond 1.2 times that it
    disarms; the current is clamped. Values too large for the frame mean no limit."""
    return make(axis, "Set_Limits", {"velocity_rev_s": min(speed_rad_s / math.tau, HIGHEST_REV_S),
                                     "current_a": min(current_a, HIGHEST_A)})


def make_clear_errors(axis: OdriveAxis) -> Frame:
    """Clear standing errors; the axis stays idle."""
    return make(axis, "Clear_Errors", {"identify": 0})


def make_estop(axis: OdriveAxis) -> Frame:
    """Disarm at once; the error stands until cleared."""
    return make(axis, "Estop", {})


def make_endstop_query(axis: OdriveAxis) -> Frame:
    """Query the limit switch; the answer is a TxSdo frame, which `parse` accepts."""
    return make_parameter_query(axis, axis.endstop_endpoint)


def make_parameter_query(axis: OdriveAxis, endpoint: int) -> Frame:
    """Query one parameter by its number in the firmware's own table; `parse_parameter` accepts the answer."""
    return make(axis, "RxSdo", {"opcode": SDO_READ, "endpoint": endpoint, "value": 0})


def make_parameter_write(axis: OdriveAxis, endpoint: int, data: bytes) -> Frame:
    """Set one parameter by its number, or call a function (no data); the data match the parameter's length. No answer
    follows."""
    return Frame(0, frame_id(axis, "RxSdo"), struct.pack("<BHB", SDO_WRITE, endpoint, 0) + data)


def make_version_query(axis: OdriveAxis) -> Frame:
    """Query the version; the answer has the same id, and `parse_version` accepts it."""
    return Frame(0, frame_id(axis, "Get_Version"), b"", is_remote=True)


def make_address_query(axis: OdriveAxis) -> Frame:
    """Query the serial number; the answer has the same id, and `parse_serial` accepts it."""
    return Frame(0, frame_id(axis, "Address"), b"", is_remote=True)


def parse(axis: OdriveAxis, frame: Frame, previous: MotorReading) -> MotorReading:
    """Return `previous` updated by one frame.

    A remote frame (another host's question) and an answer about another endpoint change nothing. BadFrame: wrong
    length, non-finite or implausible value, or an id that is not among `frame_ids(axis)`.
    """
    if frame.is_remote:
        return previous
    message = READINGS.get(frame.arbitration_id - (axis.node << 5))
    if message is None:
        raise BadFrame(_unexpected(axis, frame, *READINGS.values()))
    values = _parse(axis, message, frame)
    sign, t_ns = axis.direction, frame.t_ns
    if message == "Get_Encoder_Estimates":
        return replace(previous, t_ns=t_ns, position_rad=sign * math.tau * values["position_rev"],
                       velocity_rad_s=sign * math.tau * values["velocity_rev_s"])
    if message == "Get_Iq":
        return replace(previous, current_t_ns=t_ns, current_a=sign * values["measured_a"])
    if message == "Heartbeat":
        return replace(previous, heartbeat_t_ns=t_ns, axis_state=int(values["axis_state"]),
                       axis_error=int(values["axis_error"]))
    if message == "Get_Bus_Voltage_Current":
        return replace(previous, bus_t_ns=t_ns, bus_v=values["bus_v"])
    if message == "Get_Error":        # no stamp: each heartbeat says the errors again, and its age is asked
        return replace(previous, axis_error=int(values["active_errors"]) | int(values["disarm_reason"]))
    return _with_endstop(axis, values, t_ns, previous)


def parse_version(axis: OdriveAxis, frame: Frame) -> tuple[int, int, int]:
    """Return the firmware version (major, minor, revision); BadFrame for anything else."""
    values = _parse(axis, "Get_Version", frame)
    return int(values["firmware_major"]), int(values["firmware_minor"]), int(values["firmware_revision"])


def parse_serial(axis: OdriveAxis, frame: Frame) -> str:
    """Return the serial number as the manufacturer prints it; BadFrame for anything else."""
    return f"{int(_parse(axis, 'Address', frame)['serial']):012X}"


def parse_parameter(axis: OdriveAxis, frame: Frame) -> tuple[int, bytes]:
    """Return the parameter's number and its four bytes (shorter ones come first); BadFrame for anything else."""
    values = _parse(axis, "TxSdo", frame)
    return int(values["endpoint"]), int(values["value"]).to_bytes(4, "little")


def _with_endstop(axis: OdriveAxis, values: Values, t_ns: int, previous: MotorReading) -> MotorReading:
    if not axis.endstop_endpoint or values["endpoint"] != axis.endstop_endpoint:
        return previous
    if values["value"] not in (0, 1):
        raise BadFrame(ENDSTOP_VALUE(device=name_of(axis), value=values["value"]))
    return replace(previous, endstop_t_ns=t_ns, endstop=values["value"] == 1)


def make(axis: OdriveAxis, message: str, values: Values) -> Frame:
    """Return one of the messages about this axis, whichever node of the DBC file sends it."""
    return Frame(0, frame_id(axis, message), load_codec("odrive").make(message, values))


def _parse(axis: OdriveAxis, message: str, frame: Frame) -> dict[str, float]:
    if frame.arbitration_id != frame_id(axis, message) or frame.is_remote:
        raise BadFrame(_unexpected(axis, frame, message))
    data = frame.data
    if message == "TxSdo" and 5 <= len(data) < 8:
        data = data.ljust(8, b"\0")               # an answer is only as long as the parameter, one byte for a switch
    return load_codec("odrive").parse_frame(message, frame, name_of(axis), data)


def _unexpected(axis: OdriveAxis, frame: Frame, *wanted: str) -> Reason:
    return FRAME_UNEXPECTED(device=name_of(axis), frame=frame.name, wanted=wanted)
