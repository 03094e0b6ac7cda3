"""A motor axis of the configuration as its driver. The one place of the robot that knows drivers by name."""

from functools import partial

from truearc.hw.dc_motor import DcMotor
from truearc.hw.devices.advisory.motor import AdvisoryMotor
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.devices.odrive.motor import OdriveMotor
from truearc.hw.devices.spark import frames as spark
from truearc.hw.devices.spark.motor import SparkHeartbeat, SparkMotor
from truearc.hw.motor import Motor
from truearc.hw.readings import MotorReading
from truearc.robot.config.schema import AdvisoryAxis, Axis, Config, InputError, OdriveAxis, SparkAxis


def name_axes(config: Config) -> tuple[tuple[str, Axis], ...]:
    """Every motor axis and what it is called: the flywheels, the hood, the feeder."""
    wheels = ((f"flywheel motor {number}", axis) for number, axis in enumerate(config.axes.flywheels, 1))
    return (*wheels, ("hood motor", config.axes.hood), ("feeder motor", config.axes.feeder))


def make_motors(config: Config) -> tuple[Motor, ...]:
    """The axes' drivers, in the order of `name_axes`; InputError names two axes that are one device."""
    heartbeat = SparkHeartbeat()
    motors = tuple(_make_motor(axis, heartbeat) for _, axis in name_axes(config))
    owner: dict[tuple[int, bool], str] = {}
    for (name, _), motor in zip(name_axes(config), motors, strict=True):
        for key in motor.ids():
            if owner.setdefault(key, name) != name:
                raise InputError(f"axes: {owner[key]} and {name} are the same device (CAN frame 0x{key[0]:x})")
    return motors


def odrive_axis(axis: OdriveAxis) -> odrive.OdriveAxis:
    return odrive.OdriveAxis(axis.node, axis.direction, axis.endstop_endpoint)


def spark_axis(axis: SparkAxis) -> spark.SparkAxis:
    return spark.SparkAxis(axis.device, axis.direction, axis.has_endstop)


def error_words(axis: Axis, motor: MotorReading) -> tuple[str, ...]:
    """What its device says is wrong with it, in words; empty when it is healthy."""
    match axis:
        case OdriveAxis() | AdvisoryAxis(listens_to="odrive"):
            return odrive.error_words(motor.axis_error)
        case SparkAxis():
            return spark.error_words(motor.axis_error)
        case AdvisoryAxis():          # that it obeys another, and was switched on, is as it should be
            return spark.error_words(motor.axis_error & spark.FAULTS)


def is_driven(axis: Axis, motor: MotorReading) -> bool:
    """Whether its device does as it is asked, by us or, of an advisory axis, by whom it belongs to."""
    match axis:
        case OdriveAxis() | AdvisoryAxis(listens_to="odrive"):
            return motor.axis_state == odrive.CLOSED_LOOP
        case SparkAxis():
            return motor.axis_state == spark.DRIVEN
        case AdvisoryAxis():
            return True               # another's SPARK does not say whether it is enabled


def _make_motor(axis: Axis, heartbeat: SparkHeartbeat) -> Motor:
    match axis:
        case OdriveAxis():
            return OdriveMotor(odrive_axis(axis))
        case SparkAxis():
            motor = DcMotor(axis.stall_torque_nm, axis.free_speed_rad_s, axis.rated_v)
            return SparkMotor(spark_axis(axis), motor, heartbeat)
        case AdvisoryAxis(listens_to="odrive"):
            theirs = odrive.OdriveAxis(axis.device, axis.direction)
            return AdvisoryMotor(odrive.frame_ids(theirs), False, partial(odrive.parse, theirs))
        case AdvisoryAxis():
            heard = spark.SparkAxis(axis.device, axis.direction, axis.has_endstop)
            return AdvisoryMotor(spark.frame_ids(heard), True, partial(spark.parse, heard))
