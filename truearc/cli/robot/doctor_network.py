"""`truearc doctor` on the robot's NetworkTables: listens, and hands what it heard to the checks."""

import argparse
import math
from collections import Counter
from collections.abc import Iterator, Sequence

from truearc.cli.common import SHIPPED
from truearc.hw.finding import Finding, failure
from truearc.hw.protocols import Clock
from truearc.hw.real.clock import MonotonicClock
from truearc.robot.advice.advice_io import advised_columns
from truearc.robot.advice.nt_keys import NtKeys, Reading
from truearc.robot.config.schema import Config, InputError, load_config
from truearc.robot.config.shot_map import as_signal, load_map
from truearc.robot.doctor.network import HeardKeys, check_network, check_tags, keys_wanted

NS_PER_S = 1_000_000_000
LOOK_NS = 10_000_000
CONNECT_S = 5.0                       # for the library to find the server


def look_at_network(config: Config) -> Iterator[Finding]:
    """As [nt4] says, with the camera for tags; the latter alone without it."""
    if config.nt4 is None:
        yield from check_tags(config, None)
        return
    yield from _listen_and_check(config, config.nt4.server, *keys_wanted(config), seconds=2.0)


def look_beside(args: argparse.Namespace) -> Iterator[Finding]:
    """For `truearc advise` with --nt and --map."""
    if args.nt is None or args.map is None:
        raise InputError("--nt and --map belong together: where the robot is, and which keys say what")
    config, shot_map = load_config(args.config or SHIPPED), load_map(args.map)
    lively = [as_signal(said).key for said in advised_columns(shot_map, config).values()]
    quiet = [as_signal(said).key for said in (shot_map.shots.feed, shot_map.outcome.key) if said]
    seen, still = keys_wanted(config)
    yield from _listen_and_check(config, args.nt, [*lively, *seen], [*quiet, *shot_map.outcome.buttons, *still],
                                 args.seconds)


def _listen_and_check(config: Config, server: str, lively: Sequence[str], still: Sequence[str],
                      seconds: float) -> Iterator[Finding]:
    try:
        keys = NtKeys(server, [*lively, *still])
    except InputError as error:
        yield failure("NetworkTables server", str(error), "install it, or correct the address")
        return
    try:
        heard = listen(keys, MonotonicClock(), seconds)
    finally:
        keys.close()
    yield from check_network(server, lively, still, heard)
    if heard.is_connected:
        yield from check_tags(config, heard.newest)


def listen(keys: NtKeys, clock: Clock, seconds: float) -> HeardKeys:
    """Wait for the server, then read every key for so long."""
    began_ns = clock.now_ns()
    while not keys.connected and clock.now_ns() - began_ns < CONNECT_S * NS_PER_S:
        clock.sleep_until_ns(clock.now_ns() + LOOK_NS)
    newest, changes, ahead_s, offsets_s = dict[str, Reading](), Counter[str](), -math.inf, list[float]()
    began_ns = clock.now_ns()
    while keys.connected and clock.now_ns() - began_ns < seconds * NS_PER_S:
        clock.sleep_until_ns(clock.now_ns() + LOOK_NS)
        before, newest = newest, dict(keys.read(clock.now_ns()))
        changes.update(key for key, reading in newest.items() if key in before and reading.value != before[key].value)
        ahead_s = max(ahead_s, keys.ahead_s())
        if (offset_s := keys.offset_s) is not None:
            offsets_s.append(offset_s)
    return HeardKeys(seconds, keys.connected, newest, changes, ahead_s, offsets_s)
