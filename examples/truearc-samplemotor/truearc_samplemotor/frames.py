"""The frames of the sample motor: encoding of commands and decoding of reports. No I/O.

An arbitration id has 11 bits: the id for node 0 plus the node. On the wire, positions are revolutions of the motor
shaft; here they are radians, and the axis's `direction` has been applied.
"""

import math
from pathlib import Path

from msgspec import Struct
from msgspec.structs import replace

from truearc.hw.codec import Codec, Values, read_codec
from truearc.hw.fault_codes import ERROR_OVER_TEMPERATURE, FRAME_UNEXPECTED
from truearc.hw.protocols import BadFrame, ErrorTable, Frame, MotorReading, errors_in
from truearc.hw.reason import Reason
from truearc_samplemotor.reasons import SUPPLY_LOW

DBC = Path(__file__).with_name("samplemotor.dbc")
REVOLUTION_RAD = 2.0 * math.pi
WATCHDOG_MS = 100                     # without a duty for this long the output is 0
FIRMWARE = 1                          # whose frames these are
IDLE, DRIVEN = 0, 1
READINGS = ("Motion", "Health")       # what becomes part of a MotorReading
FAULTS: ErrorTable = ((0x1, ERROR_OVER_TEMPERATURE), (0x2, SUPPLY_LOW))


class SampleAxis(Struct, frozen=True):
    """One motor on the bus."""

    node: int                         # 0-62
    direction: int                    # +1 or -1


def codec() -> Codec:
    return read_codec(DBC)


def frame_id(axis: SampleAxis, message: str) -> int:
    """Arbitration id (11 bits) of one of the device's messages."""
    return codec().base_id(message) + axis.node


def make_duty(axis: SampleAxis, duty: float) -> Frame:
    """Apply this share of the bus voltage, -1 to 1; feeds the watchdog. BadFrame if it is not in that range."""
    return _make(axis, "Set_Duty", {"duty": axis.direction * duty})


def make_clear(axis: SampleAxis) -> Frame:
    """Forget faults that no longer stand."""
    return _make(axis, "Clear_Faults", {})


def make_health_query(axis: SampleAxis) -> Frame:
    """Ask for a Health frame now."""
    return Frame(0, frame_id(axis, "Health"), bytes(7), is_remote=True)


def parse(axis: SampleAxis, frame: Frame, previous: MotorReading) -> MotorReading:
    """`previous` brought up to date by one frame.

    BadFrame: wrong length, non-finite or implausible value, or the id of another frame.
    """
    if frame.is_remote:
        return previous
    message = next((name for name in READINGS if frame_id(axis, name) == frame.arbitration_id), None)
    if message is None:
        raise BadFrame(FRAME_UNEXPECTED(device=_name(axis), frame=frame.name, wanted=READINGS))
    try:
        values = codec().parse(message, frame.data)
    except BadFrame as error:
        raise BadFrame(error.reason.about(device=_name(axis), frame=frame.name)) from error
    sign, t_ns = axis.direction, frame.t_ns
    if message == "Motion":
        return replace(previous, t_ns=t_ns, position_rad=sign * REVOLUTION_RAD * values["position_rev"],
                       velocity_rad_s=sign * REVOLUTION_RAD * values["velocity_rev_s"])
    return replace(previous, heartbeat_t_ns=t_ns, axis_state=int(values["is_driven"]), axis_error=int(values["faults"]),
                   current_t_ns=t_ns, current_a=sign * values["current_a"], bus_t_ns=t_ns, bus_v=values["bus_v"])


def firmware_of(axis: SampleAxis, frame: Frame) -> int | None:
    """The firmware that a Health frame names; None for any other frame."""
    if frame.is_remote or frame.arbitration_id != frame_id(axis, "Health"):
        return None
    return int(codec().parse("Health", frame.data)["firmware"])


def errors_of(axis_error: int) -> tuple[Reason, ...]:
    """The faults in a bit field."""
    return errors_in(axis_error, FAULTS)


def _name(axis: SampleAxis) -> str:
    return f"samplemotor node {axis.node}"


def _make(axis: SampleAxis, message: str, values: Values) -> Frame:
    return Frame(0, frame_id(axis, message), codec().make(message, values))
