"""Settings inside an axis that its cyclic frames do not show: its watchdog and its encoder's filter.

A parameter's number differs between firmware versions, so the table of the axes' own version is needed: the maker's
flat_endpoints.json, {"fw_version": "0.6.10", "endpoints": {name: {"id": number, "type": type}}}.
"""

import json
import math
import struct
from collections.abc import Iterator, Mapping

from truearc.hw.devices.family import Endpoints, Heard
from truearc.hw.devices.odrive import frames as odrive
from truearc.hw.devices.odrive.frames import OdriveAxis
from truearc.hw.finding import Finding, failure, ok, warning
from truearc.hw.protocols import BadFrame, Frame

WATCHDOG_ON, WATCHDOG_S = "axis0.config.enable_watchdog", "axis0.config.watchdog_timeout"
BANDWIDTH = "axis0.config.encoder_bandwidth"
ASKED = (WATCHDOG_ON, WATCHDOG_S, BANDWIDTH)
LONGEST_S = 0.5                       # that a motor may go on after the robot has fallen silent
SHORTEST_S = 0.05                     # the robot feeds it each 25 ms
NOT_ASKED = "not asked: no table of parameters was given"
GIVE = "give its firmware's flat_endpoints.json to --endpoints"


def parse_endpoints(text: str) -> Endpoints:
    """The contents of flat_endpoints.json; ValueError says what is missing."""
    try:
        table = json.loads(text)
        ids = {str(name): int(entry["id"]) for name, entry in table["endpoints"].items() if "id" in entry}
        firmware = str(table["fw_version"])
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"not a table of endpoints (flat_endpoints.json): {error!r}") from error
    for name in ASKED:
        if name not in ids:
            raise ValueError(f"has no endpoint {name!r}")
    return Endpoints(firmware, ids)


def parameter_queries(axis: OdriveAxis, endpoints: Endpoints | None) -> list[Frame]:
    """What to ask of an axis: reads only."""
    return [] if endpoints is None else [odrive.make_parameter_query(axis, endpoints.ids[name]) for name in ASKED]


def check_parameters(name: str, axis: OdriveAxis, endpoints: Endpoints | None, tick_hz: int,
                     heard: Heard) -> Iterator[Finding]:
    """All findings about parameters; without a table, that they were not asked for."""
    watchdog, encoder_filter = f"{name}, watchdog", f"{name}, encoder filter"
    if endpoints is None:
        yield from (warning(check, NOT_ASKED, GIVE) for check in (watchdog, encoder_filter))
        return
    if (finding := _check_table(f"{name}, parameter numbers", axis, endpoints, heard)) is not None:
        yield finding
    answers = _answers(axis, endpoints, heard)
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


def _check_table(check: str, axis: OdriveAxis, endpoints: Endpoints, heard: Heard) -> Finding | None:
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


def _answers(axis: OdriveAxis, endpoints: Endpoints, heard: Heard) -> dict[str, bytes]:
    numbers = {endpoints.ids[name]: name for name in ASKED}
    answers: dict[str, bytes] = {}
    for frame in heard.of(odrive.frame_id(axis, "TxSdo")):
        try:
            number, data = odrive.parse_parameter(axis, frame)
        except BadFrame:
            continue                              # check_errors says so
        if number in numbers:
            answers[numbers[number]] = data
    return answers
