"""Motors of another controller, an ODrive or a SPARK, as a MotorFamily of its own: heard, never commanded."""

from collections.abc import Iterator
from functools import partial
from typing import Any, Literal

from msgspec import Struct
from msgspec.structs import replace

from truearc.hw.bus_rules import Rules
from truearc.hw.devices import family
from truearc.hw.devices.drivers import HeardMotor
from truearc.hw.devices.family import AttachedMotor, Axis, AxisCheck, CanNode, Finding, Heard, MotorFamily, failure, ok
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.devices.odrive.family import ODRIVE
from truearc.hw.devices.spark import frames as spark
from truearc.hw.devices.spark.family import SPARK
from truearc.hw.emulated.nodes import Node
from truearc.hw.protocols import MotorReading
from truearc.hw.reason import Reason


class AdvisoryConfig(Struct, Axis, frozen=True, forbid_unknown_fields=True, tag_field="driver", tag="advisory"):
    """Another controller's motor: its frames are heard, and nothing is ever sent to it."""

    listens_to: Literal["odrive", "spark"]    # whose frames they are
    device: CanNode
    direction: family.Direction
    has_endstop: bool                 # its frames tell of a limit switch at the negative end; only a SPARK's do


def make_rules(axis: AdvisoryConfig, each_tick: int) -> Rules:
    kind, theirs = _theirs(axis)
    return replace(kind.make_rules(theirs, each_tick), allowed=())


def errors(axis: AdvisoryConfig, motor: MotorReading) -> tuple[Reason, ...]:
    if axis.listens_to == "odrive":
        return odrive.errors_of(motor.axis_error)
    return spark.errors_of(motor.axis_error & spark.FAULTS)     # it obeys another, and was switched on: no errors


def is_driven(axis: AdvisoryConfig, motor: MotorReading) -> bool:
    """Another's SPARK does not report whether it is enabled."""
    return axis.listens_to == "spark" or motor.axis_state == odrive.CLOSED_LOOP


def examine(axis: AdvisoryConfig, check: AxisCheck, heard: Heard) -> Iterator[Finding]:
    """Whether anything is heard of the device."""
    status = f"{check.name}, status"
    if any(heard.of(*key) for key in _make_motor(axis).ids()):
        yield ok(status, "is heard; it belongs to another controller")
    else:
        yield failure(status, "is silent", "look at whether its controller is on, and on this bus")


def make_node(axis: AdvisoryConfig, motor: AttachedMotor) -> Node:
    kind, theirs = _theirs(axis)
    return kind.make_node(theirs, motor)


def _theirs(axis: AdvisoryConfig) -> tuple[MotorFamily[Any], Any]:
    """The family of the device, and the device as one of that family."""
    if axis.listens_to == "odrive":
        return ODRIVE, odrive.OdriveAxis(axis.device, axis.direction)
    return SPARK, spark.SparkAxis(axis.device, axis.direction, axis.has_endstop)


def _make_motor(axis: AdvisoryConfig) -> HeardMotor:
    kind, theirs = _theirs(axis)
    frames = odrive if kind is ODRIVE else spark
    return HeardMotor("its controller", frames.frame_ids(theirs), kind is SPARK, partial(frames.parse, theirs))


ADVISORY = MotorFamily(
    driver="advisory", axis=AdvisoryConfig, example=AdvisoryConfig("spark", 11, 1, False), dbc=None,
    is_commanded=False, make_motors=lambda axes, bounds: tuple(map(_make_motor, axes)), make_rules=make_rules,
    errors=errors, is_driven=is_driven, questions=lambda axis, endpoints: (), examine=examine,
    make_node=make_node)
