"""The parser of a command, for the command line, for shell completion and for the tests."""

import argparse
from importlib import import_module
from typing import Protocol, cast

from truearc.cli.registry import Command


class CommandModule(Protocol):
    """What the module of a command has."""

    DESCRIPTION: str
    EXAMPLE: str

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Add the options of the command; loads no numerical library."""

    def main(self, args: argparse.Namespace) -> int:
        """Run the command; returns 0 done or 1 a check failed, raises InputError on bad input."""


def load_module(command: Command) -> CommandModule:
    """Import the module behind a command."""
    return cast(CommandModule, import_module(command.module))


def make_parser(command: Command) -> argparse.ArgumentParser:
    """Return the parser of a command: description, example, `--quiet` and the command's own options."""
    module = load_module(command)
    parser = argparse.ArgumentParser(prog=f"truearc {command.name}", description=module.DESCRIPTION,
                                     epilog=f"example: {module.EXAMPLE}")
    fill_parser(parser, module)
    return parser


def fill_parser(parser: argparse.ArgumentParser, module: CommandModule) -> None:
    """Add the arguments of a command to a parser that exists already."""
    parser.add_argument("--quiet", action="store_true", help="no progress")
    module.add_arguments(parser)
