"""Entry points of installed distributions, loaded one by one; what cannot be loaded is named."""

from importlib.metadata import EntryPoint
from typing import Any


class PluginError(ValueError):
    """An entry point cannot be used; the message names its distribution."""


def distribution_of(point: EntryPoint) -> str:
    """Name and version of the distribution that declares it."""
    return f"{point.dist.name} {point.dist.version}" if point.dist else "an unknown distribution"


def place_of(point: EntryPoint) -> str:
    """Distribution, group, name and value, for messages."""
    return f"{distribution_of(point)}: entry point {point.group}: {point.name} = {point.value}"


def load_plugin(point: EntryPoint) -> Any:
    """Import what the entry point names.

    Raises:
        PluginError: it cannot be imported, whatever the reason.
    """
    try:
        return point.load()
    except Exception as error:
        raise PluginError(f"{place_of(point)}: {type(error).__name__}: {error}; fix or uninstall it") from error
