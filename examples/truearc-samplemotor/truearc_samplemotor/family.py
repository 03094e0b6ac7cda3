"""The MotorFamily of the sample motor, which declares everything that truearc needs to know about it."""

from collections.abc import Iterator, Sequence

from truearc.hw.bus_rules import Rules, allow, allow_seldom, kinds_of
from truearc.hw.devices.drivers import DcMotor
from truearc.hw.devices.family import (
    Axis,
    AxisCheck,
    Bounds,
    CanNode,
    Direction,
    Endpoints,
    Finding,
    Heard,
    MotorFamily,
    Positive,
    failure,
    ok,
    warning,
)
from truearc.hw.protocols import NS_PER_MS, Frame, MotorReading
from truearc.hw.reason import Reason
from truearc_samplemotor import frames
from truearc_samplemotor.emulator import SampleNode
from truearc_samplemotor.frames import DBC, SampleAxis
from truearc_samplemotor.motor import SampleMotor
from truearc_samplemotor.reasons import MESSAGES

HEALTH_NS = 50 * NS_PER_MS


class SampleConfig(SampleAxis, Axis, frozen=True, forbid_unknown_fields=True, tag_field="driver", tag="samplemotor"):
    """The table of one axis in launcher.toml."""

    node: CanNode
    direction: Direction
    stall_torque_nm: Positive         # the motor's data sheet, at the shaft that the encoder counts
    free_speed_rad_s: Positive
    rated_v: Positive


def make_motors(axes: Sequence[SampleConfig], bounds: Sequence[Bounds]) -> list[SampleMotor]:
    """The device has no limits of its own, so `bounds` are of no use to it."""
    return [SampleMotor(axis, DcMotor(axis.stall_torque_nm, axis.free_speed_rad_s, axis.rated_v)) for axis in axes]


def make_rules(axis: SampleAxis, each_tick: int) -> Rules:
    by_host, by_device = ([frames.frame_id(axis, message) for message in frames.codec().sent_by(node)]
                          for node in ("Host", "Motor"))
    return Rules((allow(frames.make_duty(axis, 0.0), each_tick),
                  *allow_seldom([frames.make_clear(axis), frames.make_health_query(axis)])),
                 kinds_of(by_host, False), kinds_of(by_device, False),
                 {(frames.frame_id(axis, "Health"), False, False): HEALTH_NS})


def errors(axis: SampleAxis, motor: MotorReading) -> tuple[Reason, ...]:
    return frames.errors_of(motor.axis_error)


def is_driven(axis: SampleAxis, motor: MotorReading) -> bool:
    return motor.axis_state == frames.DRIVEN


def questions(axis: SampleAxis, endpoints: Endpoints | None) -> list[Frame]:
    return [frames.make_health_query(axis)]


def examine(axis: SampleAxis, check: AxisCheck, heard: Heard) -> Iterator[Finding]:
    """Whether the device answers, with the firmware whose frames these are, and without a fault."""
    status = f"{check.name}, status"
    answers = heard.of(frames.frame_id(axis, "Health"))
    if not answers:
        yield failure(status, f"node {axis.node} is silent", "look at its power and plug, and at its node number")
        return
    values = frames.codec().parse("Health", answers[-1].data)
    if values["firmware"] != frames.FIRMWARE:
        yield failure(status, f"has firmware {values['firmware']:.0f}", f"update it to {frames.FIRMWARE}")
    elif faults := frames.errors_of(int(values["faults"])):
        yield warning(status, ", ".join(fault.code for fault in faults),
                      "arming clears faults that have ended; one that returns has a cause")
    else:
        yield ok(status, f"firmware {frames.FIRMWARE}, no fault")


SAMPLEMOTOR = MotorFamily(
    driver="samplemotor", axis=SampleConfig, example=SampleConfig(9, 1, 0.7, 1000.0, 12.0), dbc=DBC, is_commanded=True,
    make_motors=make_motors, make_rules=make_rules, errors=errors, is_driven=is_driven, questions=questions,
    examine=examine, make_node=SampleNode, messages=MESSAGES)
