"""REV SPARK MAX and Flex as a MotorFamily."""

from collections.abc import Sequence
from typing import Annotated

from msgspec import Meta

from truearc.hw.codec import DBC
from truearc.hw.dc_motor import DcMotor
from truearc.hw.devices.axis import Axis, Bounds, TorquePerAmp
from truearc.hw.devices.family import AttachedMotor, MotorFamily
from truearc.hw.devices.spark import frames as spark
from truearc.hw.devices.spark.bus_rules import make_rules
from truearc.hw.devices.spark.doctor import examine, questions
from truearc.hw.devices.spark.emulator import SparkNode, SparkSettings
from truearc.hw.devices.spark.motor import SparkHeartbeat, SparkMotor


class SparkConfig(spark.SparkAxis, Axis, frozen=True, forbid_unknown_fields=True, omit_defaults=True,
                  tag_field="driver", tag="spark"):
    """A REV SPARK MAX or Flex, given duties, which follow from what the motor's data sheet says; see
    truearc.hw.dc_motor."""

    has_endstop: bool                 # a limit switch on its data port ends the negative direction
    stall_torque_nm: Annotated[float, Meta(gt=0.0, le=100.0)]     # at the shaft that is counted, at the rated voltage
    free_speed_rad_s: Annotated[float, Meta(gt=1.0, le=10_000.0)]
    rated_v: Annotated[float, Meta(ge=1.0, le=60.0)]
    torque_nm_a: TorquePerAmp = 0.0   # of the motor; 0: not known, and its stall current limit stays as it is stored


def make_motors(axes: Sequence[SparkConfig], bounds: Sequence[Bounds]) -> tuple[SparkMotor, ...]:
    heartbeat = SparkHeartbeat()
    return tuple(SparkMotor(axis, DcMotor(axis.stall_torque_nm, axis.free_speed_rad_s, axis.rated_v), heartbeat,
                            spark.settings(axis, one, axis.torque_nm_a))
                 for axis, one in zip(axes, bounds, strict=True))


def make_node(axis: spark.SparkAxis, motor: AttachedMotor) -> SparkNode:
    return SparkNode(axis, motor.name, motor.plant, SparkSettings(motor.kt_nm_a, motor.resistance_ohm),
                     motor.endstop if axis.has_endstop else None)


SPARK = MotorFamily(
    driver="spark", axis=SparkConfig, signs_current=False, example=SparkConfig(3, 1, True, 2.6, 594.0, 12.0),
    dbc=DBC / "spark.dbc",
    is_commanded=True, make_motors=make_motors, make_rules=make_rules,
    errors=lambda axis, motor: spark.errors_of(motor.axis_error),
    is_driven=lambda axis, motor: motor.axis_state == spark.DRIVEN, questions=questions, examine=examine,
    make_node=make_node)
