"""REV SPARK MAX and Flex as a MotorFamily: its table, its bus rules and its doctor."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Annotated

from msgspec import Meta
from msgspec.structs import replace

from truearc.hw.bus_rules import Rules, allow, allow_seldom, kinds_of
from truearc.hw.codec import DBC
from truearc.hw.devices import family
from truearc.hw.devices.drivers import DcMotor
from truearc.hw.devices.family import AttachedMotor, Axis, AxisCheck, Bounds, Finding, Heard, failure, ok, warning
from truearc.hw.devices.spark import frames as spark
from truearc.hw.devices.spark.emulator import SparkNode, SparkSettings
from truearc.hw.devices.spark.frames import SparkAxis
from truearc.hw.devices.spark.motor import SparkHeartbeat, SparkMotor
from truearc.hw.fault_codes import BY_NAME
from truearc.hw.protocols import NS_PER_MS, BadFrame, Frame, MotorReading
from truearc.hw.reason import listed

PULSE_NS = 10 * NS_PER_MS             # STATUS_0: how often a device says how it is; its maker's own setting


def make_rules(axis: spark.SparkAxis, each_tick: int) -> Rules:
    """`each_tick`: how often within WINDOW_NS a frame may be sent that each tick sends once."""
    allowed = (allow(spark.make_duty(axis, 0.0), each_tick), allow(spark.make_heartbeat(()), each_tick),
               # twice: it may have reset
               allow(spark.make_setting(axis, spark.IDLE_MODE, 0.0), 2 * len(spark.PARAMETERS)),
               *allow_seldom([spark.make_statuses(axis, spark.STATUSES), spark.make_clear_faults(axis),
                              spark.make_version_query(axis)]))
    by_host, by_device = (kinds_of(spark.ids_sent_by(axis, node), True) for node in ("Host", "Spark"))
    return Rules(allowed, by_host, by_device, {(spark.frame_id(axis, "STATUS_0"), True, False): PULSE_NS})


def make_encoder_rules(axis: spark.SparkAxis, settings: Mapping[int, float] | None, each_tick: int) -> Rules:
    """Of a SPARK that has the encoder on its data port; settings: of that, None where nothing is sent to it."""
    if settings is None:
        return replace(make_rules(axis, each_tick), allowed=())
    parameter, value = next(iter(settings.items()))
    allowed = (allow(spark.make_setting(axis, parameter, value), 2 * len(settings)),
               *allow_seldom([spark.make_statuses(axis, spark.ENCODER_STATUSES), spark.make_version_query(axis)]))
    return replace(make_rules(axis, each_tick), allowed=allowed)


LOOK = "look at its power and plug, and at its CAN id in REV's hardware client"


def questions(axis: SparkAxis, endpoints: family.Endpoints | None) -> list[Frame]:
    """Its version. STATUS_1 and STATUS_2 are turned on, and its parameters set, by the run itself."""
    return [spark.make_version_query(axis)]


def examine(axis: SparkAxis, check: AxisCheck, heard: Heard) -> Iterator[Finding]:
    """All findings about the axis."""
    yield check_firmware(check.name, axis, heard)
    yield check_status(check.name, axis, heard)
    if estimates := heard.of(spark.frame_id(axis, "STATUS_2"), extended=True):     # off before the first run
        yield family.check_estimates(check.name, estimates, partial(spark.parse, axis))


def check_firmware(name: str, axis: SparkAxis, heard: Heard) -> Finding:
    """Who answered the question for its version."""
    check = f"{name}, firmware"
    answers = heard.of(spark.frame_id(axis, "GET_FIRMWARE_VERSION"), extended=True)
    if not answers:
        return failure(check, f"device {axis.device} does not answer", LOOK)
    unique = {frame.data for frame in heard.of(spark.frame_id(axis, "UNIQUE_ID_BROADCAST"), extended=True)}
    if (count := max(heard.answering(spark.make_version_query(axis)), len(unique))) > 1:
        return failure(check, f"{count} devices answer as {axis.device}", "give each a CAN id of its own")
    try:
        version = spark.parse_version(axis, answers[0])
    except BadFrame as error:
        return failure(check, f"answers what cannot be read ({error})", "is it a SPARK MAX or Flex?")
    said = ".".join(map(str, version))
    if not spark.OLDEST_FIRMWARE <= version[0] <= spark.NEWEST_FIRMWARE:
        return failure(check, f"has firmware {said}; its frames are not known to be those of "
                       f"{spark.OLDEST_FIRMWARE} and {spark.NEWEST_FIRMWARE}", "update it with REV's hardware client")
    return ok(check, f"firmware {said}")


def check_status(name: str, axis: SparkAxis, heard: Heard) -> Finding:
    """What its status frames say of it; that it obeys another controller is a check of its own."""
    check = f"{name}, status"
    keys = [(frame_id, True) for frame_id in spark.frame_ids(axis)]
    reading, refused = heard.read(keys, partial(spark.parse, axis), MotorReading())
    if refused:
        return failure(check, f"sends what cannot be ({refused[0]})",
                       "look at the wiring and at whether another device has its CAN id")
    if not any(heard.of(*key) for key in keys):
        return failure(check, f"device {axis.device} is silent", LOOK)
    if errors := spark.errors_of(reading.axis_error & spark.FAULTS):
        return warning(check, listed(errors, BY_NAME), "arming clears what does not stand; what comes back has a cause")
    switch = f"; its limit switch is {'closed' if reading.endstop else 'open'}" if axis.has_endstop else ""
    return ok(check, f"speaks, and has no fault that it tells of{switch}")


class SparkConfig(spark.SparkAxis, Axis, frozen=True, forbid_unknown_fields=True, omit_defaults=True,
                  tag_field="driver", tag="spark"):
    """A REV SPARK MAX or Flex, given duties, which follow from what the motor's data sheet says; see
    truearc.hw.devices.drivers."""

    has_endstop: bool                 # a limit switch on its data port ends the negative direction
    stall_torque_nm: Annotated[float, Meta(gt=0.0, le=100.0)]     # at the shaft that is counted, at the rated voltage
    free_speed_rad_s: Annotated[float, Meta(gt=1.0, le=10_000.0)]
    rated_v: Annotated[float, Meta(ge=1.0, le=60.0)]
    torque_nm_a: family.TorquePerAmp = 0.0    # of the motor; 0: not known, its stall current limit stays as stored


def make_motors(axes: Sequence[SparkConfig], bounds: Sequence[Bounds]) -> tuple[SparkMotor, ...]:
    heartbeat = SparkHeartbeat()
    return tuple(SparkMotor(axis, DcMotor(axis.stall_torque_nm, axis.free_speed_rad_s, axis.rated_v), heartbeat,
                            spark.settings(axis, one, axis.torque_nm_a))
                 for axis, one in zip(axes, bounds, strict=True))


def make_node(axis: spark.SparkAxis, motor: AttachedMotor) -> SparkNode:
    return SparkNode(axis, motor.name, motor.plant, SparkSettings(motor.kt_nm_a, motor.resistance_ohm),
                     motor.endstop if axis.has_endstop else None)


SPARK = family.MotorFamily(
    driver="spark", axis=SparkConfig, signs_current=False, example=SparkConfig(3, 1, True, 2.6, 594.0, 12.0),
    dbc=DBC / "spark.dbc",
    is_commanded=True, make_motors=make_motors, make_rules=make_rules,
    errors=lambda axis, motor: spark.errors_of(motor.axis_error),
    is_driven=lambda axis, motor: motor.axis_state == spark.DRIVEN, questions=questions, examine=examine,
    make_node=make_node)
