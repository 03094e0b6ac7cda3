"""REV SPARK MAX and Flex as a MotorFamily."""

from collections.abc import Sequence

from truearc.hw.codec import DBC
from truearc.hw.dc_motor import DcMotor
from truearc.hw.devices.axis import Axis, Positive
from truearc.hw.devices.bus_rules import NS_PER_MS, Rules, allow_seldom, kinds_of
from truearc.hw.devices.family import AttachedMotor, MotorFamily
from truearc.hw.devices.spark import frames as spark
from truearc.hw.devices.spark.doctor import examine, questions
from truearc.hw.devices.spark.emulator import SparkNode, SparkSettings
from truearc.hw.devices.spark.motor import SparkHeartbeat, SparkMotor
from truearc.hw.tx_allowlist import allow

PULSE_NS = 10 * NS_PER_MS             # STATUS_0: how often a device says how it is; its maker's own setting


class SparkConfig(spark.SparkAxis, Axis, frozen=True, forbid_unknown_fields=True, tag_field="driver", tag="spark"):
    """A REV SPARK MAX or Flex, given duties, which follow from what the motor's data sheet says; see
    truearc.hw.dc_motor."""

    has_endstop: bool                 # a limit switch on its data port ends the negative direction
    stall_torque_nm: Positive         # at the shaft that the encoder counts, at the rated voltage
    free_speed_rad_s: Positive
    rated_v: Positive


def make_motors(axes: Sequence[SparkConfig]) -> tuple[SparkMotor, ...]:
    heartbeat = SparkHeartbeat()
    return tuple(SparkMotor(axis, DcMotor(axis.stall_torque_nm, axis.free_speed_rad_s, axis.rated_v), heartbeat)
                 for axis in axes)


def make_rules(axis: spark.SparkAxis, each_tick: int) -> Rules:
    """Frames that an axis may be sent, and those that it and hosts send.

    `each_tick`: how often within WINDOW_NS a frame may be sent that each tick sends once.
    """
    settings = spark.settings(axis)
    parameter, value = next(iter(settings.items()))
    allowed = (allow(spark.make_duty(axis, 0.0), each_tick), allow(spark.make_heartbeat(()), each_tick),
               allow(spark.make_setting(axis, parameter, value), 2 * len(settings)),      # twice: it may have reset
               *allow_seldom([spark.make_statuses(axis, spark.STATUSES), spark.make_clear_faults(axis),
                              spark.make_version_query(axis)]))
    by_host, by_device = (kinds_of(spark.ids_sent_by(axis, node), True) for node in ("Host", "Spark"))
    return Rules(allowed, by_host, by_device, {(spark.frame_id(axis, "STATUS_0"), True, False): PULSE_NS})


def make_node(axis: spark.SparkAxis, motor: AttachedMotor) -> SparkNode:
    return SparkNode(axis, motor.name, motor.plant, SparkSettings(motor.kt_nm_a, motor.resistance_ohm),
                     motor.endstop if axis.has_endstop else None)


SPARK = MotorFamily(
    driver="spark", axis=SparkConfig, example=SparkConfig(3, 1, True, 2.6, 594.0, 12.0), dbc=DBC / "spark.dbc",
    is_commanded=True, make_motors=make_motors, make_rules=make_rules,
    errors=lambda axis, motor: spark.errors_of(motor.axis_error),
    is_driven=lambda axis, motor: motor.axis_state == spark.DRIVEN, questions=questions, examine=examine,
    make_node=make_node)
