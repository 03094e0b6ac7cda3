"""One SPARK axis, as far as it tells without being set up: its firmware, whether it speaks, what is wrong with it."""

from collections.abc import Iterator
from functools import partial

from truearc.hw.devices.family import AxisCheck, Endpoints, Heard, check_estimates
from truearc.hw.devices.spark import frames as spark
from truearc.hw.devices.spark.frames import SparkAxis
from truearc.hw.fault_codes import BY_NAME
from truearc.hw.finding import Finding, failure, ok, warning
from truearc.hw.protocols import BadFrame, Frame, MotorReading
from truearc.hw.reason import listed

LOOK = "look at its power and plug, and at its CAN id in REV's hardware client"


def questions(axis: SparkAxis, endpoints: Endpoints | None) -> list[Frame]:
    """Its version. STATUS_1 and STATUS_2 are turned on, and its parameters set, by the run itself."""
    return [spark.make_version_query(axis)]


def examine(axis: SparkAxis, check: AxisCheck, heard: Heard) -> Iterator[Finding]:
    """All findings about the axis."""
    yield check_firmware(check.name, axis, heard)
    yield check_status(check.name, axis, heard)
    if estimates := heard.of(spark.frame_id(axis, "STATUS_2"), extended=True):     # off before the first run
        yield check_estimates(check.name, estimates, partial(spark.parse, axis))


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
