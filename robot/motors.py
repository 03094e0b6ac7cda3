"""A motor axis of the configuration as its driver. The one place of the robot that knows drivers by name."""

from functools import partial

from hw import odrive, spark
from hw.advisory_motor import AdvisoryMotor
from hw.dc_motor import DcMotor
from hw.motor import Motor
from hw.odrive_motor import OdriveMotor
from hw.reading import MotorReading
from hw.spark_motor import Heartbeat, SparkMotor
from robot.config import AdvisoryAxis, Axis, BadInput, Config, OdriveAxis, SparkAxis


def name_axes(config: Config) -> tuple[tuple[str, Axis], ...]:
    """Every motor axis and what it is called: the flywheels, the hood, the feeder."""
    wheels = ((f"flywheel motor {number}", axis) for number, axis in enumerate(config.axes.flywheels, 1))
    return (*wheels, ("hood motor", config.axes.hood), ("feeder motor", config.axes.feeder))


def make_motors(config: Config) -> tuple[Motor, ...]:
    """The axes' drivers, in the order of `name_axes`; BadInput names two axes that are one device."""
    heartbeat = Heartbeat()
    motors = tuple(_make_motor(axis, heartbeat) for _, axis in name_axes(config))
    owner: dict[tuple[int, bool], str] = {}
    for (name, _), motor in zip(name_axes(config), motors, strict=True):
        for key in motor.ids():
            if owner.setdefault(key, name) != name:
                raise BadInput(f"axes: {owner[key]} and {name} are the same device (CAN frame 0x{key[0]:x})")
    return motors


def odrive_axis(axis: OdriveAxis) -> odrive.Axis:
    return odrive.Axis(axis.node, axis.direction, axis.endstop_endpoint)


def spark_axis(axis: SparkAxis) -> spark.Axis:
    return spark.Axis(axis.device, axis.direction, axis.has_endstop)


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


def _make_motor(axis: Axis, heartbeat: Heartbeat) -> Motor:
    match axis:
        case OdriveAxis():
            return OdriveMotor(odrive_axis(axis))
        case SparkAxis():
            motor = DcMotor(axis.stall_torque_nm, axis.free_speed_rad_s, axis.rated_v)
            return SparkMotor(spark_axis(axis), motor, heartbeat)
        case AdvisoryAxis(listens_to="odrive"):
            theirs = odrive.Axis(axis.device, axis.direction)
            return AdvisoryMotor(odrive.frame_ids(theirs), False, partial(odrive.parse, theirs))
        case AdvisoryAxis():
            heard = spark.Axis(axis.device, axis.direction, axis.has_endstop)
            return AdvisoryMotor(spark.frame_ids(heard), True, partial(spark.parse, heard))
