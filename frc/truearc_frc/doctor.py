"""The doctor's checks of the robot's NetworkTables: the server, keys and clocks, and whether a camera sees tags."""

import math
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

from truearc.errors import InputError
from truearc.hw.devices.family import Finding, failure, ok, warning
from truearc.hw.protocols import NS_PER_S, Clock
from truearc.hw.real.clock import MonotonicClock
from truearc.robot.config.schema import Config
from truearc.robot.config.shot_map import ShotMap, as_signal
from truearc_frc.advice import Scaled, scaled_columns
from truearc_frc.inputs import calibration_key, keys_of_camera, keys_of_velocity
from truearc_frc.keys import NtKeys, Reading
from truearc_frc.table import LISTEN_S, nt4_of

LOOK_NS = 10_000_000
CONNECT_S = 5.0                       # for the library to find the server
AHEAD_S = 0.05                        # stamps from the future: more than rounding
DRIFT_S = 0.02                        # between two answers of the server to what time it is
SERVER, CLOCKS, TAGS = "NetworkTables server", "NetworkTables clocks", "camera for tags"


class HeardKeys(NamedTuple):
    """The values received in `seconds`.

    newest: each key that was present at the end. changes: how often each changed. ahead_s: the most by which a
    timestamp was ahead of our clock. offsets_s: the server's clock minus ours, for each measurement.
    """

    seconds: float
    is_connected: bool
    newest: Mapping[str, Reading]
    changes: Mapping[str, int]
    ahead_s: float
    offsets_s: Sequence[float]


def keys_wanted(config: Config) -> tuple[list[str], list[str]]:
    """Return the keys that [nt4] names: those that must change, and those that may stay constant."""
    nt4 = nt4_of(config)
    if nt4 is None:
        return [], []
    lively, still = list[str](), list[str]()
    if nt4.vision is not None:
        seen = keys_of_camera(nt4.vision)
        lively, still = seen[:1], [*seen[1:], *filter(None, [calibration_key(nt4.vision)])]     # its heartbeat
    if nt4.velocity is not None:
        named = keys_of_velocity(nt4.velocity)
        alive = [nt4.velocity.alive] if nt4.velocity.alive else named
        lively, still = lively + alive, still + [key for key in named if key not in alive]
    return lively, still


def check_network(server: str, lively: Sequence[str], still: Sequence[str], heard: HeardKeys,
                  columns: Iterable[Scaled] = (), texts: Collection[str] = ()) -> Iterator[Finding]:
    """Check the server, each key and the clocks.

    lively: keys that must change. still: keys that must be present. columns: keys whose values have bounds. texts: keys
    that need not be numbers.
    """
    if not heard.is_connected:
        yield failure(SERVER, f"{server} does not answer", "is the robot on, its program running, this computer in its "
                      "network? Give its team number or address")
        return
    yield ok(SERVER, f"{server} answers")
    by_key = {column.key: column for column in columns}
    for key in dict.fromkeys([*lively, *still]):
        column = by_key.get(key)
        yield _check_value(key, heard.newest.get(key), column, key in texts) or _check_changes(
            key, key in lively, heard, column)
    yield _check_clocks(heard)


def _check_value(key: str, reading: Reading | None, column: Scaled | None, may_be_text: bool) -> Finding | None:
    check = f"key {key}"
    if reading is None:
        return failure(check, "the robot publishes no such key", "compare its name with a dashboard's list of topics")
    if isinstance(reading.value, str):
        return None if may_be_text else failure(check, f"is a text, {reading.value!r}", "publish it as a number")
    if not math.isfinite(reading.value):
        return failure(check, "is not a number", "look at what publishes it")
    if column is None or column.low <= (value := column.value(reading.value)) <= column.high:
        return None
    return failure(check, f"{column.column} would be {value:.6g}, possible is {column.low:g} to {column.high:g}",
                   "look at what publishes it, and at its unit in the map")


def _check_changes(key: str, must_change: bool, heard: HeardKeys, column: Scaled | None) -> Finding:
    check, reading, changes = f"key {key}", heard.newest[key], heard.changes.get(key, 0)
    if must_change and changes == 0:
        return warning(check, f"has not changed in {heard.seconds:g} s: it would count as stale",
                       "publish it as it is measured, with its noise; or name in the map an `alive`, which changes in "
                       "each loop")
    shown = reading.value if isinstance(reading.value, str) else f"{reading.value:.6g}"
    if column is not None and not isinstance(reading.value, str):
        shown = f"{column.column} {column.value(reading.value):.4g} (sent as {shown})"
    return ok(check, f"{shown}, {changes / heard.seconds:.0f} changes per second")


def _check_clocks(heard: HeardKeys) -> Finding:
    if heard.ahead_s > AHEAD_S:
        return failure(CLOCKS, f"stamps are up to {heard.ahead_s:.2f} s ahead of ours",
                       "restart what publishes them: its clock was set after it had connected")
    if not heard.offsets_s:
        return warning(CLOCKS, "the server has not sent its time", "listen for longer (--seconds)")
    drift_s = max(heard.offsets_s) - min(heard.offsets_s)
    if drift_s > DRIFT_S:
        return warning(CLOCKS, f"the server's clock changed by {drift_s * 1e3:.0f} ms against ours while listening",
                       "use a cable: the network delays what is sent unevenly")
    return ok(CLOCKS, f"no stamp is ahead of ours; the server's clock keeps within {drift_s * 1e3:.0f} ms")


def check_tags(config: Config, newest: Mapping[str, Reading]) -> Iterator[Finding]:
    """Check whether the camera that sees tags is calibrated; no finding without such a camera. newest: the keys
    read."""
    nt4 = nt4_of(config)
    vision = None if nt4 is None else nt4.vision
    if vision is None:
        return
    if (key := calibration_key(vision)) is None:
        yield warning(TAGS, "a Limelight does not say whether it is calibrated", "look at its own page: Calibration")
    elif key not in newest:
        yield failure(TAGS, f"PhotonVision has no calibration of {vision.camera!r} at this resolution",
                      "calibrate it on PhotonVision's page: without, targetPose has no pose")
    else:
        yield ok(TAGS, f"PhotonVision has a calibration of {vision.camera!r}")


def look_at_server(config: Config) -> Iterator[Finding]:
    """Check the server as [nt4] specifies, including its camera for tags."""
    nt4 = nt4_of(config)
    assert nt4 is not None
    yield from _listen_and_check(config, nt4.server, *keys_wanted(config), seconds=LISTEN_S)


def look_beside(config: Config, server: str, shot_map: ShotMap, seconds: float) -> Iterator[Finding]:
    """Check the keys that `truearc advise` reads by a map."""
    columns = [*scaled_columns(shot_map, config).values()]
    quiet = [as_signal(said).key for said in (shot_map.shots.feed, shot_map.outcome.key) if said]
    seen, still = keys_wanted(config)
    lively, resting = [one.alive or one.key for one in columns], [one.key for one in columns if one.alive]
    yield from _listen_and_check(config, server, [*lively, *seen],
                                 [*resting, *quiet, *shot_map.outcome.buttons, *still], seconds, columns,
                                 [shot_map.outcome.key])


def _listen_and_check(config: Config, server: str, lively: Sequence[str], still: Sequence[str],
                      seconds: float, columns: Sequence[Scaled] = (), texts: Sequence[str] = ()) -> Iterator[Finding]:
    try:
        keys = NtKeys(server, [*lively, *still])
    except InputError as error:
        yield failure(SERVER, str(error), "correct the address")
        return
    try:
        heard = hear(keys, MonotonicClock(), seconds)
    finally:
        keys.close()
    yield from check_network(server, lively, still, heard, columns, texts)
    if heard.is_connected:
        yield from check_tags(config, heard.newest)


def hear(keys: NtKeys, clock: Clock, seconds: float) -> HeardKeys:
    """Wait for the server, then read every key for the given time."""
    began_ns = clock.now_ns()
    while not keys.connected and clock.now_ns() - began_ns < CONNECT_S * NS_PER_S:
        clock.sleep_until_ns(clock.now_ns() + LOOK_NS)
    newest, changes, ahead_s, offsets_s = dict[str, Reading](), Counter[str](), -math.inf, list[float]()
    began_ns = clock.now_ns()
    while keys.connected and clock.now_ns() - began_ns < seconds * NS_PER_S:
        clock.sleep_until_ns(clock.now_ns() + LOOK_NS)
        before, newest = newest, dict(keys.read(clock.now_ns()))
        changes.update(key for key, reading in newest.items() if key in before and reading.t_ns != before[key].t_ns)
        ahead_s = max(ahead_s, keys.ahead_s())
        if (offset_s := keys.offset_s) is not None:
            offsets_s.append(offset_s)
    return HeardKeys(seconds, keys.connected, newest, changes, ahead_s, offsets_s)
