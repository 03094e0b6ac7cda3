"""`truearc doctor --set`: bring what the devices keep, watchdogs and limits, to what the rig needs, after a yes."""

import argparse
import sys
from collections.abc import Iterator
from typing import NamedTuple

from truearc.hw.devices.family import Endpoints, Stored, StoredSettings, listen
from truearc.hw.protocols import Bus, Clock, LinkLost
from truearc.hw.real.can_bus import open_can
from truearc.hw.real.clock import MonotonicClock
from truearc.robot.config.schema import Config, InputError, load_config
from truearc.robot.doctor.devices import load_endpoints
from truearc.robot.doctor.stored import stored_of

LISTEN_S = 0.5                        # answers come at once; a heartbeat every 0.1 s


class Wrong(NamedTuple):
    """A setting of an axis that is not as the rig needs it; `has`: None where nothing was answered."""

    axis: str
    setting: Stored
    has: float | None


def set_devices(args: argparse.Namespace) -> int:
    """Print what differs, ask, write, save and read it back; 0 when everything is well at the end, else 1."""
    if args.config is None or args.endpoints is None:
        raise InputError("--set needs --config and --endpoints: whose axes, and their firmware's flat_endpoints.json")
    config, endpoints = load_config(args.config), load_endpoints(args.endpoints)
    clock = MonotonicClock()
    try:
        bus = open_can(config.can.interface, config.can.channel, config.can.bitrate, clock)
    except LinkLost as error:
        raise InputError(f"{args.config}: can: {error}") from error
    try:
        return set_over(bus, clock, config, endpoints, args.yes)
    except LinkLost as error:
        raise InputError(f"{args.config}: can: {error}; some settings may have been written") from error
    finally:
        bus.close()


def set_over(bus: Bus, clock: Clock, config: Config, endpoints: Endpoints, yes: bool) -> int:
    """As set_devices, on an open bus; raises LinkLost."""
    known = stored_of(config, endpoints, must=True)
    if not known:
        raise InputError("axes: none keeps settings that can be written; a run sets what its axes need")
    wrong = list(_compare(bus, clock, known))
    if not wrong:
        print(f"watchdogs and limits of {len(known)} axes are as this rig needs them")
        return 0
    for one in wrong:
        print(f"{one.axis}: {one.setting.name} is {_shown(one.has)}, the rig needs {one.setting.wanted:g}")
    axes = list(dict.fromkeys(one.axis for one in wrong))
    if not yes and not _confirmed(f"write and save {len(wrong)} settings? {len(axes)} axes restart"):
        print("nothing was written")
        return 1
    for one in wrong:
        bus.write(one.setting.write)
    for axis in axes:
        if unwritten := [name for name, value in _read(bus, clock, known[axis]) if value is None]:
            raise InputError(f"{axis}: {', '.join(unwritten)}: no answer after writing; nothing was saved")
        for frame in known[axis].save:
            bus.write(frame)
    listen(bus, clock, (), max(known[axis].restart_s for axis in axes))
    left = list(_compare(bus, clock, {axis: known[axis] for axis in axes}))
    for one in left:
        print(f"error: {one.axis}: {one.setting.name} is {_shown(one.has)} after writing; expected "
              f"{one.setting.wanted:g}", file=sys.stderr)
    print(f"{len(wrong) - len(left)} of {len(wrong)} settings are written, saved and read back")
    return 1 if left else 0


def _compare(bus: Bus, clock: Clock, known: dict[str, StoredSettings]) -> Iterator[Wrong]:
    """What is not well; InputError names an axis that may not be written to."""
    for axis, stored in known.items():
        heard = listen(bus, clock, stored.questions(), LISTEN_S)
        if why := stored.refuse(heard):
            raise InputError(f"{axis}: {why}")
        for setting in stored.settings:
            if not setting.is_well(has := setting.read(heard)):
                yield Wrong(axis, setting, has)


def _read(bus: Bus, clock: Clock, stored: StoredSettings) -> list[tuple[str, float | None]]:
    heard = listen(bus, clock, stored.questions(), LISTEN_S)
    return [(setting.name, setting.read(heard)) for setting in stored.settings]


def _shown(value: float | None) -> str:
    return "unknown (no answer)" if value is None else f"{value:g}"


def _confirmed(question: str) -> bool:
    """Ask at the terminal; InputError where there is nobody to answer."""
    if not sys.stdin.isatty():
        raise InputError("--set: nobody to ask, the input is no terminal; expected --yes")
    return input(f"{question} (yes/no): ").strip().lower() == "yes"
