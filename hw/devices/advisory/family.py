"""Another controller's ODrive or SPARK as a MotorFamily of its own: heard, never commanded."""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Literal

from msgspec import Struct
from msgspec.structs import replace

from truearc.hw.devices.advisory.motor import AdvisoryMotor
from truearc.hw.devices.axis import Axis, CanNode, Direction
from truearc.hw.devices.bus_rules import Rules
from truearc.hw.devices.family import AttachedMotor, AxisCheck, Endpoints, MotorFamily
from truearc.hw.devices.listening import Heard
from truearc.hw.devices.odrive import bus_rules as odrive_rules
from truearc.hw.devices.odrive import family as odrive_family
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.devices.spark import bus_rules as spark_rules
from truearc.hw.devices.spark import family as spark_family
from truearc.hw.devices.spark import frames as spark
from truearc.hw.emulated.nodes import Node
from truearc.hw.finding import Finding, failure, ok
from truearc.hw.protocols import Frame
from truearc.hw.readings import MotorReading


class AdvisoryConfig(Struct, Axis, frozen=True, forbid_unknown_fields=True, tag_field="driver", tag="advisory"):
    """Another controller's motor: its frames are heard, and nothing is ever sent to it."""

    listens_to: Literal["odrive", "spark"]    # whose frames they are
    device: CanNode
    direction: Direction
    has_endstop: bool                 # its frames tell of a limit switch at the negative end; only a SPARK's do


def make_motors(axes: Sequence[AdvisoryConfig]) -> tuple[AdvisoryMotor, ...]:
    return tuple(map(_make_motor, axes))


def make_rules(axis: AdvisoryConfig, each_tick: int) -> Rules:
    theirs = (odrive_rules.make_rules(_odrive(axis), each_tick) if axis.listens_to == "odrive"
              else spark_rules.make_rules(_spark(axis), each_tick))
    return replace(theirs, allowed=())


def error_words(axis: AdvisoryConfig, motor: MotorReading) -> tuple[str, ...]:
    if axis.listens_to == "odrive":
        return odrive.error_words(motor.axis_error)
    return spark.error_words(motor.axis_error & spark.FAULTS)     # it obeys another, and was switched on: no errors


def is_driven(axis: AdvisoryConfig, motor: MotorReading) -> bool:
    """Another's SPARK does not report whether it is enabled."""
    return axis.listens_to == "spark" or motor.axis_state == odrive.CLOSED_LOOP


def questions(axis: AdvisoryConfig, endpoints: Endpoints | None) -> tuple[Frame, ...]:
    return ()


def examine(axis: AdvisoryConfig, check: AxisCheck, heard: Heard) -> Iterator[Finding]:
    """Whether anything is heard of the device."""
    status = f"{check.name}, status"
    if any(heard.of(*key) for key in _make_motor(axis).ids()):
        yield ok(status, "is heard; it belongs to another controller")
    else:
        yield failure(status, "is silent", "look at whether its controller is on, and on this bus")


def make_node(axis: AdvisoryConfig, motor: AttachedMotor) -> Node:
    if axis.listens_to == "odrive":
        return odrive_family.make_node(_odrive(axis), motor)
    return spark_family.make_node(_spark(axis), motor)


def _odrive(axis: AdvisoryConfig) -> odrive.OdriveAxis:
    return odrive.OdriveAxis(axis.device, axis.direction)


def _spark(axis: AdvisoryConfig) -> spark.SparkAxis:
    return spark.SparkAxis(axis.device, axis.direction, axis.has_endstop)


def _make_motor(axis: AdvisoryConfig) -> AdvisoryMotor:
    if axis.listens_to == "odrive":
        return AdvisoryMotor(odrive.frame_ids(_odrive(axis)), False, partial(odrive.parse, _odrive(axis)))
    return AdvisoryMotor(spark.frame_ids(_spark(axis)), True, partial(spark.parse, _spark(axis)))


ADVISORY = MotorFamily(
    driver="advisory", axis=AdvisoryConfig, example=AdvisoryConfig("spark", 11, 1, False), dbc=None,
    is_commanded=False, make_motors=make_motors, make_rules=make_rules, error_words=error_words, is_driven=is_driven,
    questions=questions, examine=examine, make_node=make_node)
