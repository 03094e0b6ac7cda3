"""The ODrive as a MotorFamily: its table, motor driver, bus rules, doctor checks and stored settings.

The watchdog and encoder filter settings do not appear in the cyclic frames, so they are read on request. A parameter's
number differs between firmware versions, so the table for the installed version is needed. It is the maker's
flat_endpoints.json, {"fw_version": "0.6.10", "endpoints": {name: {"id": number, "type": type}}}.
"""

import contextlib
import json
import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Annotated

from msgspec import Meta
from msgspec.structs import replace

from truearc.hw import codec, fault_codes, reason
from truearc.hw.bus_rules import Rules, allow, allow_seldom, kinds_of
from truearc.hw.devices import drivers, family
from truearc.hw.devices.family import Axis, Finding, Heard, failure, ok, warning
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.devices.odrive.emulator import SETTINGS, OdriveNode, OdriveSettings
from truearc.hw.devices.odrive.frames import OdriveAxis
from truearc.hw.protocols import NS_PER_MS, BadFrame, Frame, MotorReading, Order

RETRY_NS = 100_000_000                # how often orders to come up or to let go are repeated: a frame may be lost
ENDSTOP_NS = 50_000_000               # between two questions about the limit switch ...
ENDSTOP_LOST_NS = 250_000_000         # ... but each tick where an answer is overdue, and not missing for longer
# An unchanged torque is repeated at this interval, each tick at 200 Hz. With half of the frames lost, a watchdog of
# 0.1 s then trips once in hours; with 25 ms, once a second
FEED_NS = 4_000_000


class OdriveMotor(drivers.AskedMotor):
    """A Motor driven by torques.

    Errors persist until the motor is commanded again, so the operator clears them by arming. When released, or while
    its readings arrive too late, it is ordered to give no torque and to go idle, whatever state it reports.
    limits: its own, set before it is driven (odrive.make_limits); none if they are unknown.
    """

    def __init__(self, axis: OdriveAxis, limits: Frame | None = None) -> None:
        super().__init__(odrive.name_of(axis), odrive.frame_ids(axis), False, partial(odrive.parse, axis),
                         odrive.make_version_query(axis))
        self._axis = axis
        self._ids = (*self._ids, (self._question.arbitration_id, False))
        mode = odrive.make_controller_mode(axis, odrive.TORQUE, odrive.PASSTHROUGH)
        self._start = (mode, *(() if limits is None else (limits,)), odrive.make_state(axis, odrive.CLOSED_LOOP))
        self._stop = (odrive.make_torque(axis, 0.0), odrive.make_state(axis, odrive.IDLE))
        self._wanted = self._driven = False
        self._asked_ns = -RETRY_NS
        self._endstop_ns = self._fed_ns = 0
        self._asked_nm = 0.0

    def take(self, frame: Frame) -> None:
        if frame.arbitration_id == self._question.arbitration_id:
            odrive.parse_version(self._axis, frame)
            self._take_answer(frame)
        else:
            super().take(frame)

    def order(self, torque_nm: float | None, t_ns: int) -> Order:
        wanted = torque_nm is not None
        frames: tuple[Frame, ...] = (odrive.make_clear_errors(self._axis),) if wanted and not self._wanted else ()
        self._wanted = wanted
        driven_nm = torque_nm if self._trip.is_timely else None
        frames += self._keep_state(driven_nm is not None, t_ns) + self._asked()
        overdue = ENDSTOP_NS <= t_ns - self.reading.endstop_t_ns <= ENDSTOP_LOST_NS
        if self._axis.endstop_endpoint and (overdue or t_ns - self._endstop_ns >= ENDSTOP_NS):
            self._endstop_ns = t_ns
            frames += (odrive.make_endstop_query(self._axis),)
        return Order(frames) if driven_nm is None else Order(frames + self._feed(driven_nm, t_ns), driven_nm)

    def release(self) -> tuple[Frame, ...]:
        return self._stop

    def _keep_state(self, driven: bool, t_ns: int) -> tuple[Frame, ...]:
        changed, self._driven = driven != self._driven, driven
        if not changed and ((driven and self.reading.axis_state == odrive.CLOSED_LOOP)
                            or t_ns - self._asked_ns < RETRY_NS):
            return ()
        self._asked_ns = t_ns
        if changed:
            self._fed_ns = t_ns - FEED_NS         # its torque is said at once
        return self._start if driven else self._stop

    def _feed(self, torque_nm: float, t_ns: int) -> tuple[Frame, ...]:
        if torque_nm == self._asked_nm and t_ns - self._fed_ns < FEED_NS:
            return ()
        self._asked_nm, self._fed_ns = torque_nm, t_ns
        return (odrive.make_torque(self._axis, torque_nm),)


PULSE_NS = 100 * NS_PER_MS            # heartbeat: its default period


def make_rules(axis: OdriveAxis, each_tick: int) -> Rules:
    """Return the rules; `each_tick`: how often within WINDOW_NS a frame may be sent that each tick sends once."""
    seldom = [odrive.make_clear_errors(axis), odrive.make_controller_mode(axis, odrive.TORQUE, odrive.PASSTHROUGH),
              odrive.make_estop(axis), odrive.make_version_query(axis)]
    if axis.torque_nm_a:
        seldom.append(odrive.make_limits(axis, 0.0, 0.0))
    seldom.append(odrive.make_address_query(axis))
    by_host, by_device = (kinds_of(odrive.ids_sent_by(axis, node), False) for node in ("Host", "Axis"))
    always = [odrive.make_torque(axis, 0.0), odrive.make_state(axis, odrive.IDLE)]      # to let go is never refused
    if axis.endstop_endpoint:
        always.append(odrive.make_endstop_query(axis))
    return Rules((*(allow(frame, each_tick) for frame in always), *allow_seldom(seldom)), by_host, by_device,
                 {(odrive.frame_id(axis, "Heartbeat"), False, False): PULSE_NS})


class OdriveConfig(OdriveAxis, Axis, frozen=True, forbid_unknown_fields=True, omit_defaults=True,
                   tag_field="driver", tag="odrive"):
    """An ODrive driven by torques."""

    endstop_endpoint: Annotated[int, Meta(ge=0, le=65535)]    # SDO endpoint that reads the limit switch; 0 = none
    torque_nm_a: family.TorquePerAmp = 0.0   # its torque_constant; 0: not known, its own limits stay as they are stored


def make_motors(axes: Sequence[OdriveConfig], bounds: Sequence[family.Bounds]) -> tuple[OdriveMotor, ...]:
    return tuple(OdriveMotor(axis, make_limits(axis, one)) for axis, one in zip(axes, bounds, strict=True))


def make_limits(axis: OdriveConfig, bounds: family.Bounds) -> Frame | None:
    """Return the frame for the device's own limits; None if one is unknown, since the frame sets both."""
    speed_rad_s, current_a = family.speed_limit_rad_s(bounds), family.current_limit_a(bounds, axis.torque_nm_a)
    return None if speed_rad_s is None or current_a is None else odrive.make_limits(axis, speed_rad_s, current_a)


def make_node(axis: OdriveAxis, motor: family.AttachedMotor) -> OdriveNode:
    settings = replace(SETTINGS.get(motor.name, OdriveSettings()), watchdog_ms=motor.watchdog_ms,
                       is_absolute=motor.is_absolute)
    return OdriveNode(axis, motor.name, motor.plant, settings, motor.endstop if axis.endstop_endpoint else None)


# --- the doctor

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
WATCHDOG_ON, WATCHDOG_S = "axis0.config.enable_watchdog", "axis0.config.watchdog_timeout"
BANDWIDTH = "axis0.config.encoder_bandwidth"
ASKED = (WATCHDOG_ON, WATCHDOG_S, BANDWIDTH)
LONGEST_S = 0.5                       # that a motor may go on after the robot has fallen silent
SHORTEST_S = 0.05                     # the robot feeds it each tick, but may stall
NOT_ASKED = "watchdog and encoder filter are not read: no table of parameters was given"
GIVE = "give its firmware's flat_endpoints.json to --endpoints"


def questions(axis: OdriveAxis, endpoints: family.Endpoints | None) -> list[Frame]:
    """Return the queries for its version, serial number, limit switch and, if their numbers are known, parameters."""
    numbers = [] if endpoints is None else [endpoints.ids[name] for name in ASKED]
    numbers += [axis.endstop_endpoint] if axis.endstop_endpoint else []
    return [odrive.make_version_query(axis), odrive.make_address_query(axis),
            *(odrive.make_parameter_query(axis, number) for number in numbers)]


def examine(axis: OdriveAxis, check: family.AxisCheck, heard: Heard) -> Iterator[Finding]:
    """Return all findings about the axis."""
    name, endpoints = check.name, check.endpoints
    yield check_firmware(name, axis, heard)
    yield check_rates(name, axis, {"hood motor": HOOD, "feeder motor": FEEDER}.get(name, FLYWHEEL), heard)
    yield check_errors(name, axis, heard)
    estimates = heard.of(odrive.frame_id(axis, "Get_Encoder_Estimates"))
    if estimates:
        yield family.check_estimates(name, estimates, partial(odrive.parse, axis))
    if axis.endstop_endpoint and heard.of(odrive.frame_id(axis, "Get_Version")):
        yield check_switch(name, axis, heard)
    yield from check_parameters(name, axis, endpoints, check.tick_hz, heard)


def check_firmware(name: str, axis: OdriveAxis, heard: Heard) -> Finding:
    """Check who answered the version query."""
    check = f"{name}, firmware"
    answers = heard.of(odrive.frame_id(axis, "Get_Version"))
    if not answers:
        return failure(check, f"node {axis.node} does not answer", f"{LOOK}, which `odrivetool` shows")
    if (count := max(heard.answering(odrive.make_version_query(axis)), len(serials := _serials(axis, heard)))) > 1:
        named = f" (serial numbers {', '.join(sorted(serials))})" if len(serials) > 1 else ""
        return failure(check, f"{count} devices answer as node {axis.node}{named}", "give each a node id of its own")
    try:
        firmware = odrive.parse_version(axis, answers[0])
    except BadFrame as error:
        return failure(check, f"sends an unreadable answer ({error})", "is it an ODrive with firmware 0.6?")
    version = ".".join(map(str, firmware))
    if firmware[:2] != FIRMWARE:
        return failure(check, f"has firmware {version}; its frames differ from 0.6's", "flash it with 0.6")
    if axis.endstop_endpoint and firmware[2] != KNOWN_REVISION:
        return warning(check, f"has firmware {version}, and parameter numbers differ between revisions",
                       "see that endstop_endpoint is that revision's own: give its table to --endpoints")
    return ok(check, f"firmware {version}")


def _serials(axis: OdriveAxis, heard: Heard) -> set[str]:
    serials = set()
    for frame in heard.of(odrive.frame_id(axis, "Address")):
        with contextlib.suppress(BadFrame):       # it is not needed for anything else
            serials.add(odrive.parse_serial(axis, frame))
    return serials


def check_rates(name: str, axis: OdriveAxis, rates: Mapping[str, int], heard: Heard) -> Finding:
    """Check whether the required values arrive, and often enough."""
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
    """Report standing errors and invalid frames."""
    check = f"{name}, errors"
    keys = [(frame_id, False) for frame_id in odrive.frame_ids(axis)]
    reading, refused = heard.read(keys, partial(odrive.parse, axis), MotorReading())
    if refused:
        return failure(check, f"sends impossible values ({refused[-1]})",
                       "look at the wiring and at whether another device has its node id")
    if reading.axis_error:
        return warning(check, reason.listed(odrive.errors_of(reading.axis_error), fault_codes.BY_NAME),
                       "arming clears errors; one that comes back has a cause")
    if reading.heartbeat_t_ns == 0:
        return failure(check, "no heartbeat arrives", "set the axis's heartbeat to 100 ms")
    return ok(check, "none")


def check_switch(name: str, axis: OdriveAxis, heard: Heard) -> Finding:
    """Check whether the limit switch is reported at all."""
    check = f"{name}, limit switch"
    reading, _ = heard.read([(odrive.frame_id(axis, "TxSdo"), False)], partial(odrive.parse, axis), MotorReading())
    if reading.endstop_t_ns == 0:
        return failure(check, f"is not reported: no answer for parameter {axis.endstop_endpoint}",
                       "see that endstop_endpoint is that of its own firmware; without it the hood is never homed")
    return ok(check, f"reported as {'closed' if reading.endstop else 'open'}; --move tests it")


def parse_endpoints(text: str) -> family.Endpoints:
    """Parse the contents of flat_endpoints.json; ValueError says what is missing."""
    try:
        table = json.loads(text)
        ids = {str(name): int(entry["id"]) for name, entry in table["endpoints"].items() if "id" in entry}
        firmware = str(table["fw_version"])
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise ValueError(f"not a table of endpoints (flat_endpoints.json): {error!r}") from error
    if wrong := next((name for name, number in ids.items() if not 0 <= number < 1 << 16), None):
        raise ValueError(f"endpoint {wrong!r} has the id {ids[wrong]}, expected 0 to 65535")
    for name in ASKED:
        if name not in ids:
            raise ValueError(f"has no endpoint {name!r}")
    return family.Endpoints(firmware, ids)


def check_parameters(name: str, axis: OdriveAxis, endpoints: family.Endpoints | None, tick_hz: int,
                     heard: Heard) -> Iterator[Finding]:
    """Return all findings about parameters; without a table, that they were not queried."""
    watchdog, encoder_filter = f"{name}, watchdog", f"{name}, encoder filter"
    if endpoints is None:
        yield warning(f"{name}, settings", NOT_ASKED, GIVE)
        return
    if (finding := _check_table(f"{name}, parameter numbers", axis, endpoints, heard)) is not None:
        yield finding
    found = _parameters(axis, heard)
    answers = {name: found[endpoints.ids[name]] for name in ASKED if endpoints.ids[name] in found}
    silent = "does not answer", f"is its firmware {endpoints.firmware}, as the table's?"
    yield _check_watchdog(watchdog, answers) or warning(watchdog, *silent)
    yield _check_filter(encoder_filter, answers, tick_hz) or warning(encoder_filter, *silent)


def _check_watchdog(check: str, answers: Mapping[str, bytes]) -> Finding | None:
    """Whether the motor stops by itself when the robot falls silent; None without an answer."""
    enabled, timeout = answers.get(WATCHDOG_ON), answers.get(WATCHDOG_S)
    if enabled is None or timeout is None:
        return None
    timeout_s = struct.unpack("<f", timeout)[0]
    if not enabled[0]:
        return failure(check, "off: its motor would go on turning if the robot hung",
                       f"set {WATCHDOG_ON}, and {WATCHDOG_S} to 0.1")
    if not SHORTEST_S <= timeout_s <= LONGEST_S:
        return failure(check, f"waits {timeout_s:g} s", f"set {WATCHDOG_S} to 0.1")
    return ok(check, f"{timeout_s:g} s")


def _check_filter(check: str, answers: Mapping[str, bytes], tick_hz: int) -> Finding | None:
    """Whether the axis's speed is filtered so much that the dip of a shot is smeared; None without an answer."""
    answer = answers.get(BANDWIDTH)
    bandwidth = struct.unpack("<f", answer)[0] if answer else math.nan
    if not bandwidth > 0.0:
        return None
    lag_ms = 1000.0 / bandwidth
    if bandwidth < tick_hz:
        return warning(check, f"its speed lags by {lag_ms:.0f} ms, more than a tick",
                       f"set {BANDWIDTH} to {tick_hz} 1/s at least, 1000 if the encoder is not noisy")
    return ok(check, f"its speed lags by {lag_ms:.1f} ms")


def _check_table(check: str, axis: OdriveAxis, endpoints: family.Endpoints, heard: Heard) -> Finding | None:
    """Whether table, firmware and the configured limit switch belong together; None if its version is unreadable."""
    for frame in heard.of(odrive.frame_id(axis, "Get_Version"))[:1]:
        try:
            firmware = ".".join(map(str, odrive.parse_version(axis, frame)))
        except BadFrame:
            return None                           # check_firmware says so
        if firmware != endpoints.firmware:
            return failure(check, f"the table is of firmware {endpoints.firmware}, the axis has {firmware}",
                           "take the table of its own firmware")
    if axis.endstop_endpoint:
        named = [key for key, number in endpoints.ids.items() if number == axis.endstop_endpoint]
        if not any(key.endswith("endstop.endstop_state") for key in named):
            right = sorted(f"{number} = {key}" for key, number in endpoints.ids.items()
                           if key.endswith("endstop.endstop_state"))
            return failure(check, f"endstop_endpoint {axis.endstop_endpoint} is "
                           f"{named[0] if named else 'nothing'} in firmware {endpoints.firmware}, not a limit switch",
                           f"in launcher.toml take one of: {', '.join(right) or 'none in the table'}")
    return ok(check, f"as in firmware {endpoints.firmware}")


def _parameters(axis: OdriveAxis, heard: Heard) -> dict[int, bytes]:
    """The newest answer about each parameter, by its number; what cannot be read is named by check_errors."""
    answers = {}
    for frame in heard.of(odrive.frame_id(axis, "TxSdo")):
        with contextlib.suppress(BadFrame):
            number, data = odrive.parse_parameter(axis, frame)
            answers[number] = data
    return answers


# --- stored settings

SPEED, CURRENT = "axis0.controller.config.vel_limit", "axis0.config.motor.current_soft_max"
SAVE = "save_configuration"           # a function; the device restarts
GOOD_S = 0.1                          # of a watchdog: four times as long as the robot takes to feed it
NEAR = 0.01                           # a stored limit within this share is that of the rig: floats are rounded
RESTART_S = 3.0                       # until its frames are there again, with time to spare


def stored_settings(axis: OdriveAxis, bounds: family.Bounds, endpoints: family.Endpoints) -> family.StoredSettings:
    """Return the axis's watchdog, and limits if the rig knows them; KeyError names a parameter that the table lacks."""
    found = [_setting(axis, endpoints.ids[WATCHDOG_ON], WATCHDOG_ON, 1.0, 1.0, 1.0, "<?"),
             _setting(axis, endpoints.ids[WATCHDOG_S], WATCHDOG_S, GOOD_S, SHORTEST_S, LONGEST_S, "<f")]
    speed_rad_s, current_a = family.speed_limit_rad_s(bounds), family.current_limit_a(bounds, axis.torque_nm_a)
    for name, wanted in ((SPEED, None if speed_rad_s is None else speed_rad_s / math.tau), (CURRENT, current_a)):
        if wanted is not None:
            found.append(_setting(axis, endpoints.ids[name], name, wanted, wanted * (1.0 - NEAR),
                                  wanted * (1.0 + NEAR), "<f"))
    save = odrive.make_parameter_write(axis, endpoints.ids[SAVE], b"")
    return family.StoredSettings(tuple(found), (odrive.make_version_query(axis),), partial(_refuse, axis, endpoints),
                                 (save,), RESTART_S)


def _setting(axis: OdriveAxis, number: int, name: str, wanted: float, low: float, high: float,
             form: str) -> family.Stored:
    def read(heard: Heard) -> float | None:
        data = _parameters(axis, heard).get(number)
        return None if data is None else float(struct.unpack_from(form, data)[0])

    kind = bool if form == "<?" else float
    return family.Stored(name, wanted, low, high, odrive.make_parameter_query(axis, number),
                  odrive.make_parameter_write(axis, number, struct.pack(form, kind(wanted))), read)


def _refuse(axis: OdriveAxis, endpoints: family.Endpoints, heard: Heard) -> str:
    """Another firmware's table would write something else; a driven axis is in use."""
    versions = heard.of(odrive.frame_id(axis, "Get_Version"))
    try:
        firmware = ".".join(map(str, odrive.parse_version(axis, versions[-1]))) if versions else ""
    except BadFrame as error:
        return str(error)
    if firmware != endpoints.firmware:
        return (f"has firmware {firmware}, got a table of {endpoints.firmware}; expected that of its own firmware"
                if firmware else f"node {axis.node} does not answer")
    keys = [(odrive.frame_id(axis, "Heartbeat"), False)]
    reading, _ = heard.read(keys, partial(odrive.parse, axis), MotorReading())
    if reading.axis_state != odrive.IDLE:
        return f"is in state {reading.axis_state}, expected {odrive.IDLE}, idle: stop the robot first"
    return ""


ODRIVE = family.MotorFamily(
    driver="odrive", axis=OdriveConfig, example=OdriveConfig(4, 1, 0), dbc=codec.DBC / "odrive.dbc", is_commanded=True,
    make_motors=make_motors, make_rules=make_rules,
    errors=lambda axis, motor: odrive.errors_of(motor.axis_error) if motor.axis_error else (),
    is_driven=lambda axis, motor: motor.axis_state == odrive.CLOSED_LOOP, questions=questions, examine=examine,
    make_node=make_node, stored_settings=stored_settings)
