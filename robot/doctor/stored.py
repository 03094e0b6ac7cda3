"""Watchdogs and limits that the axes keep, beside what the rig needs them to be; to be written after a yes."""

import sys
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from truearc.errors import InputError
from truearc.hw.devices.family import Endpoints, Finding, Heard, Stored, StoredSettings, listen, ok, warning
from truearc.hw.devices.registry import family_of
from truearc.hw.protocols import Bus, Clock
from truearc.robot.config.schema import Config
from truearc.robot.motors import bound_axes, name_axes

LISTEN_S = 0.5                        # answers come at once; a heartbeat every 0.1 s
DO = "let `truearc doctor --set` write them, or set them with the maker's tool"


def stored_of(config: Config, endpoints: Endpoints | None, must: bool = False) -> dict[str, StoredSettings]:
    """By the axis's name, of those that keep such settings and whose numbers the table has; InputError for one that it
    lacks where all `must` be there."""
    found: dict[str, StoredSettings] = {}
    for (name, axis), bounds in zip(name_axes(config), bound_axes(config), strict=True):
        make = family_of(axis).stored_settings
        if make is not None and endpoints is not None:
            try:
                found[name] = make(axis, bounds, endpoints)
            except KeyError as error:
                if not must:
                    continue
                raise InputError(f"--endpoints: has no endpoint {error}") from error
    return found


def check_stored(known: Mapping[str, StoredSettings], heard: Heard) -> Iterator[Finding]:
    """Whether each axis keeps what the rig needs; one finding an axis."""
    for name, stored in known.items():
        check, values = f"{name}, stored settings", [(one, one.read(heard)) for one in stored.settings]
        differ = [f"{one.name} {'is not told' if has is None else f'{has:g}'}, the rig needs {one.wanted:g}"
                  for one, has in values if not one.is_well(has)]
        if differ:
            yield warning(check, "; ".join(differ), DO)
        else:
            yield ok(check, ", ".join(f"{one.name} {has:g}" for one, has in values))


class Wrong(NamedTuple):
    """A setting of an axis that is not as the rig needs it; `has`: None where nothing was answered."""

    axis: str
    setting: Stored
    has: float | None


def set_stored(bus: Bus, clock: Clock, config: Config, endpoints: Endpoints, yes: bool) -> int:
    """Print what differs, ask, write, save and read it back; 0 when everything is well at the end, else 1.

    yes: write without asking. LinkLost: some settings may have been written.
    """
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
    """Settings that are not well; InputError names an axis that may not be written to."""
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
    """Ask at the terminal; InputError where the input is not a terminal."""
    if not sys.stdin.isatty():
        raise InputError("--set: cannot ask, got an input that is not a terminal; expected --yes")
    return input(f"{question} (yes/no): ").strip().lower() == "yes"
