"""Watchdogs and limits that the axes keep, beside what the rig needs them to be."""

from collections.abc import Iterator, Mapping

from truearc.hw.devices.family import Endpoints, Heard, StoredSettings
from truearc.hw.devices.registry import family_of
from truearc.hw.finding import Finding, ok, warning
from truearc.robot.config.schema import Config, InputError
from truearc.robot.motors import bound_axes, name_axes

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
