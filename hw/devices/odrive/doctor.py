"""One ODrive axis: does it answer, with the right firmware, often enough, and without standing errors?"""

from collections.abc import Iterator, Mapping
from functools import partial
from types import MappingProxyType

from truearc.hw.devices.family import AxisCheck, Endpoints, Heard
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.devices.odrive.frames import OdriveAxis
from truearc.hw.devices.odrive.parameters import check_parameters, parameter_queries
from truearc.hw.fault_codes import BY_NAME
from truearc.hw.finding import Finding, failure, ok, warning
from truearc.hw.protocols import BadFrame, Frame, MotorReading
from truearc.hw.reason import listed

FIRMWARE = (0, 6)                     # whose frames hw/dbc/odrive.dbc describes; 0.5 has other ones under the same ids
KNOWN_REVISION = 10                   # whose parameter numbers robot/launcher.toml names
ENOUGH = 0.8                          # of the reports that should come in the time listened
LOOK = "look at its power and plug, and at its node id"
# Message -> longest period in ms that truearc needs of an axis; what it cannot do without comes first
FLYWHEEL = MappingProxyType({"Heartbeat": 100, "Get_Encoder_Estimates": 10, "Get_Iq": 10,
                             "Get_Bus_Voltage_Current": 100})
HOOD = MappingProxyType(FLYWHEEL | {"Get_Iq": 100})
FEEDER = MappingProxyType(HOOD | {"Get_Encoder_Estimates": 50})
NEEDED = ("Heartbeat", "Get_Encoder_Estimates")


def questions(axis: OdriveAxis, endpoints: Endpoints | None) -> list[Frame]:
    """Its version, and its parameters when their numbers are known."""
    return [odrive.make_version_query(axis), *parameter_queries(axis, endpoints)]


def examine(axis: OdriveAxis, check: AxisCheck, heard: Heard) -> Iterator[Finding]:
    """All findings about the axis."""
    name, endpoints = check.name, check.endpoints
    yield check_firmware(name, axis, heard)
    yield check_rates(name, axis, {"hood motor": HOOD, "feeder motor": FEEDER}.get(name, FLYWHEEL), heard)
    yield check_errors(name, axis, heard)
    yield from check_parameters(name, axis, endpoints, check.tick_hz, heard)


def check_firmware(name: str, axis: OdriveAxis, heard: Heard) -> Finding:
    """Who answered the question for its version."""
    check = f"{name}, firmware"
    answers = heard.of(odrive.frame_id(axis, "Get_Version"))
    if not answers:
        return failure(check, f"node {axis.node} does not answer", f"{LOOK}, which `odrivetool` shows")
    if len(answers) > 1:
        return failure(check, f"{len(answers)} devices answer as node {axis.node}", "give each a node id of its own")
    try:
        firmware = odrive.parse_version(axis, answers[0])
    except BadFrame as error:
        return failure(check, f"answers what cannot be read ({error})", "is it an ODrive with firmware 0.6?")
    version = ".".join(map(str, firmware))
    if firmware[:2] != FIRMWARE:
        return failure(check, f"has firmware {version}; its frames differ from 0.6's", "flash it with 0.6")
    if axis.endstop_endpoint and firmware[2] != KNOWN_REVISION:
        return warning(check, f"has firmware {version}, and parameter numbers differ between revisions",
                       "see that endstop_endpoint is that revision's own: give its table to --endpoints")
    return ok(check, f"firmware {version}")


def check_rates(name: str, axis: OdriveAxis, rates: Mapping[str, int], heard: Heard) -> Finding:
    """Whether what the robot needs to know comes, and often enough."""
    check = f"{name}, status rates"
    counts = {message: len(heard.of(odrive.frame_id(axis, message))) for message in rates}
    if not any(counts.values()):
        return failure(check, f"node {axis.node} is silent", LOOK)
    slow = {message: f"{message} {counts[message] / heard.seconds:.0f}/s instead of {1000 / period_ms:.0f}/s"
            for message, period_ms in rates.items()
            if counts[message] < ENOUGH * heard.seconds * 1000 / period_ms}
    if not slow:
        return ok(check, ", ".join(f"{message} {counts[message] / heard.seconds:.0f}/s" for message in rates))
    do = "set the axis's CAN message rates (periods in ms: " + ", ".join(
        f"{message} {rates[message]}" for message in slow) + "), and save them"
    if set(slow) & set(NEEDED):
        return failure(check, "; ".join(slow.values()), do)
    return warning(check, "; ".join(slow.values()) + ": recordings will lack it", do)


def check_errors(name: str, axis: OdriveAxis, heard: Heard) -> Finding:
    """Standing errors, and frames that cannot be meant."""
    check = f"{name}, errors"
    keys = [(frame_id, False) for frame_id in odrive.frame_ids(axis)]
    reading, refused = heard.read(keys, partial(odrive.parse, axis), MotorReading())
    if refused:
        return failure(check, f"sends what cannot be ({refused[-1]})",
                       "look at the wiring and at whether another device has its node id")
    if reading.axis_error:
        return warning(check, listed(odrive.errors_of(reading.axis_error), BY_NAME),
                       "arming clears errors; one that comes back has a cause")
    if reading.heartbeat_t_ns == 0:
        return failure(check, "no heartbeat says how it is", "set the axis's heartbeat to 100 ms")
    return ok(check, "none")
