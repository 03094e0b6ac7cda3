"""docs/reference/commands.md and docs/reference/python-api.md, made from the code: `python -m tools.site_reference`."""

import inspect
import itertools
from argparse import SUPPRESS, Action
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import truearc
from truearc.cli.parsers import make_parser
from truearc.cli.registry import COMMANDS, GROUPS, Command, load_plugins
from truearc.hw.plugins import INSTALL_HINTS

REFERENCE = Path(__file__).resolve().parents[1] / "docs" / "reference"
UNLISTED = ("help", "quiet", "force")
COMMANDS_HEAD = """# Commands

Every command of `truearc`, with its arguments and options. `--help` behind a command explains each, with an example.
`--quiet` and `--force` (write over what is there) are not listed. Exit codes: 0 done, 1 a no, 2 wrong input.
Made from the code by `python -m tools.site_reference`.
"""
API_HEAD = """# Python API

Every public name: `import truearc as ta`, then `ta.NAME`. `help(ta.NAME)` gives arguments, units, frames and errors.
Made from the code by `python -m tools.site_reference`.
"""


def commands_page() -> str:
    """The page of commands: a table for each group."""
    commands = sorted((*COMMANDS, *(one for one in load_plugins() if one.distribution in INSTALL_HINTS)),
                      key=lambda one: [*GROUPS, one.group].index(one.group))
    lines = [COMMANDS_HEAD]
    for group, members in itertools.groupby(commands, key=lambda one: one.group):
        about = f": {GROUPS[group]}" if group in GROUPS else ""
        lines += [f"## {group.capitalize()}{about}\n", "| command | does | arguments and options |", "|---|---|---|"]
        lines += [*map(_command_row, members), ""]
    return "\n".join(lines)


def _command_row(command: Command) -> str:
    actions = [one for one in make_parser(command)._actions if one.help != SUPPRESS and one.dest not in UNLISTED]
    return f"| `{command.name}` | {command.summary} | {' '.join(map(_argument, actions))} |"


def _argument(action: Action) -> str:
    name = action.option_strings[-1] if action.option_strings else _metavar(action)
    return f"`{name}`".replace("|", "\\|")


def _metavar(action: Action) -> str:
    return action.metavar if isinstance(action.metavar, str) else action.dest.upper()


def api_page() -> str:
    """The page of the Python API: a table of functions and one of classes."""
    names = sorted(truearc.__all__, key=str.lower)
    values = {name: getattr(truearc, name) for name in names}
    lines = [API_HEAD, "## Functions\n", "| call | does |", "|---|---|"]
    lines += [f"| `{name}({_parameters(value)})` | {_summary(value)} |" for name, value in values.items()
              if inspect.isroutine(value)]
    lines += ["", "## Classes and modules\n", "| name | purpose | members |", "|---|---|---|"]
    lines += [f"| `{name}` | {_summary(value)} | {' '.join(f'`{member}`' for member in _members(value))} |"
              for name, value in values.items() if not inspect.isroutine(value)]
    return "\n".join([*lines, ""])


def _parameters(value: Any) -> str:
    return ", ".join(inspect.signature(value).parameters)


def _summary(value: Any) -> str:
    return " ".join((inspect.getdoc(value) or "").partition("\n\n")[0].split()).replace("|", "\\|")


def _members(value: Any) -> Iterator[str]:
    """Public methods, properties and functions that a class or module defines itself, in their order."""
    if not inspect.isclass(value):
        yield from getattr(value, "__all__", ())
        return
    yield from (name for name, member in vars(value).items()
                if not name.startswith("_") and (inspect.isroutine(member) or isinstance(member, property)))


def main() -> None:
    """Write both pages."""
    (REFERENCE / "commands.md").write_text(commands_page(), encoding="utf-8")
    (REFERENCE / "python-api.md").write_text(api_page(), encoding="utf-8")


if __name__ == "__main__":
    main()
