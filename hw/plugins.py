"""Entry points of installed distributions, loaded one by one, and how to install what truearc itself leaves out."""

from importlib.metadata import EntryPoint
from typing import Any

PROOF, FRC = "truearc-proof", "truearc-frc"             # distributions in the repository's folders proof/ and frc/
INSTALL_HINTS = {name: f"pip install ./{name.removeprefix('truearc-')} (in a checkout of the repository)"
           for name in (PROOF, FRC)}
EXPORTS = "truearc.exports"           # group: format -> function of (ExportRows, binary file)
# command, table of launcher.toml, or format -> the distribution that has it
ELSEWHERE = {"prove": PROOF, "reproduce": PROOF, "advise": FRC, "nt4": FRC, "wpilog": FRC}


class PluginError(ValueError):
    """An entry point cannot be used; the message names its distribution."""


def needs(name: str) -> str:
    """Say which distribution has one of ELSEWHERE, and how to install it."""
    return f"needs {ELSEWHERE[name]}: {INSTALL_HINTS[ELSEWHERE[name]]}"


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


def only_point(points: tuple[EntryPoint, ...], name: str) -> EntryPoint:
    """The one entry point of a name.

    Raises:
        LookupError: there is none.
        PluginError: there are several.
    """
    if not points:
        raise LookupError(name)
    if len(points) > 1:
        raise PluginError(f"{place_of(points[0])}: {place_of(points[1])} has the same name; uninstall one of them")
    return points[0]
