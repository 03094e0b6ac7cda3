"""Every command as data, so that listing the commands imports none of them; `commands.toml` has truearc's own."""

import tomllib
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import NamedTuple

from truearc.hw.plugins import INSTALL_HINTS

ENTRY_POINTS = "truearc.commands"
OTHER_GROUP = "other"                 # of a command from another distribution that names no group


class Command(NamedTuple):
    """A command.

    Fields:
        name: The words that call it, such as `fit` or `paper fit`.
        module: Module with a docstring (the description in `--help`), EXAMPLE, add_arguments(parser) and
            main(args) -> exit code; importing it loads no numerical library.
        group: The heading of `truearc --help` that lists it; a key of GROUPS, or another distribution's own.
        summary: One line for that list.
        distribution: What to install where a package is missing; empty for truearc itself.
    """

    name: str
    module: str
    group: str
    summary: str
    distribution: str = ""


_TABLE = tomllib.loads(Path(__file__).with_name("commands.toml").read_text(encoding="utf-8"))
GROUPS: dict[str, str] = _TABLE["groups"]         # name -> what its commands are about
COMMANDS = tuple(Command(**row) for row in _TABLE["command"])
NAMES = {command.name: command for command in COMMANDS}


def find_command(argv: list[str]) -> Command | None:
    """Return the command that `argv` begins with, of two words before of one; None where it begins with none."""
    words = [" ".join(argv[:2]), *argv[:1]]
    own = next((NAMES[word] for word in words if word in NAMES), None)
    if own is not None or not argv or argv[0].startswith("-"):
        return own
    return next((command for word in words for command in load_plugins() if command.name == word), None)


@cache
def load_plugins() -> tuple[Command, ...]:
    """Return the commands of other distributions, from the entry points `truearc.commands`, sorted by name.

    Each names a module like those of COMMANDS that also has SUMMARY, and GROUP where it wants a heading of its own. A
    module that cannot be imported is listed with the reason, so that the other commands go on working.
    """
    plugins = []
    for point in sorted(entry_points(group=ENTRY_POINTS), key=lambda point: point.name):
        distribution = point.dist.name if point.dist else ""
        try:
            module = import_module(point.value)
            group, summary = getattr(module, "GROUP", OTHER_GROUP), module.SUMMARY
        except (ImportError, AttributeError) as error:
            group, summary = OTHER_GROUP, f"cannot be loaded: {error}"
        plugins.append(Command(point.name, point.value, group, summary, distribution))
    return tuple(plugins)


def install_hint(command: Command) -> str:
    """Return how to install what a command needs."""
    return INSTALL_HINTS.get(command.distribution, f"pip install '{command.distribution or 'truearc[sim]'}'")


def list_commands() -> tuple[Command, ...]:
    """Return every command that is installed: truearc's own, then those of other distributions."""
    return (*COMMANDS, *load_plugins())
