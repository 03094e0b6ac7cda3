"""Every device on the bus: what to ask, and what to make of it."""

from collections.abc import Iterator

from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.devices.spark import frames as spark
from truearc.hw.protocols import Frame
from truearc.robot.config.schema import AdvisoryAxis, Axis, Config, OdriveAxis, SparkAxis
from truearc.robot.doctor.finding import Finding, failure, ok
from truearc.robot.doctor.hood import check_encoder
from truearc.robot.doctor.listening import Heard
from truearc.robot.doctor.motors import check_errors, check_firmware, check_rates, rates_of
from truearc.robot.doctor.parameters import Endpoints, check_filter, check_table, check_watchdog
from truearc.robot.doctor.parameters import questions as parameter_questions
from truearc.robot.doctor.sparks import check_spark
from truearc.robot.motors import make_motors, name_axes, odrive_axis, spark_axis


def questions(config: Config, endpoints: Endpoints | None) -> list[Frame]:
    """Reads only: each axis's version, and its parameters when their numbers are known; nothing of advisory ones."""
    return [frame for _, axis in name_axes(config) for frame in _asked(axis, endpoints)]


def check_devices(config: Config, endpoints: Endpoints | None, heard: Heard) -> Iterator[Finding]:
    """Axes in the configuration's order, then the hood's encoder."""
    for name, axis in name_axes(config):
        match axis:
            case OdriveAxis():
                yield from _check_odrive(name, odrive_axis(axis), endpoints, config.tick_hz, heard)
            case SparkAxis():
                yield from check_spark(name, spark_axis(axis), heard)
            case AdvisoryAxis():
                yield _check_advisory(name, config, heard)
    yield check_encoder(config, heard)


def _asked(axis: Axis, endpoints: Endpoints | None) -> list[Frame]:
    match axis:
        case OdriveAxis():
            theirs = odrive_axis(axis)
            return [odrive.make_version_query(theirs), *parameter_questions(theirs, endpoints)]
        case SparkAxis():
            return [spark.make_version_query(spark_axis(axis))]
        case AdvisoryAxis():
            return []


def _check_odrive(name: str, axis: odrive.OdriveAxis, endpoints: Endpoints | None, tick_hz: int,
                  heard: Heard) -> Iterator[Finding]:
    yield check_firmware(name, axis, heard)
    yield check_rates(name, axis, rates_of(name), heard)
    yield check_errors(name, axis, heard)
    if (finding := check_table(name, axis, endpoints, heard)) is not None:
        yield finding
    yield check_watchdog(name, axis, endpoints, heard)
    yield check_filter(name, axis, endpoints, tick_hz, heard)


def _check_advisory(name: str, config: Config, heard: Heard) -> Finding:
    """Whether anything is heard of a motor that another controller drives."""
    motor = next(motor for (one, _), motor in zip(name_axes(config), make_motors(config), strict=True) if one == name)
    if any(heard.of(*key) for key in motor.ids()):
        return ok(f"{name}, status", "is heard; it belongs to another controller")
    return failure(f"{name}, status", "is silent", "look at whether its controller is on, and on this bus")
