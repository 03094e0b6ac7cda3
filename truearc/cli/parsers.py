"""The parser of a command, for the command line, for shell completion and for the tests."""

import argparse
import difflib
import re
import shlex
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn, Protocol, cast

from truearc.cli.common import number
from truearc.cli.outputs import add_force
from truearc.cli.registry import Command
from truearc.errors import InputError

# argparse's messages -> the project's; {0}, {1}: groups of the pattern, {example}: the command's example
MESSAGES = (
    (r"argument (.+?): expected .*argument.*", "{0}: its value is missing; {example}"),
    (r"argument (.+?): not allowed with argument (.+)", "{0}: excludes {1}; give one of them"),
    (r"argument (.+?): ignored explicit argument (.+)", "{0}: takes no value, got {1}; leave it out"),
    (r"argument (.+)", "{0}"),
    (r"the following arguments are required: (.+)", "{0}: missing; {example}"),
    (r"unrecognized arguments: (.+)", "{0}: not an argument of this command; {example}"),
)


class CommandModule(Protocol):
    """The module of a command; its docstring is the description in `--help`.

    One that shows no progress says `PROGRESS = False`, and has no `--quiet`.
    """

    EXAMPLE: str

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Add the options of the command; loads no numerical library."""

    def main(self, args: argparse.Namespace) -> int:
        """Run the command; returns 0 done or 1 a check failed, raises InputError on bad input."""


class HelpText(argparse.HelpFormatter):
    """Help that states the default of every option that has one and does not describe it itself."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        stated = action.default in ("", argparse.SUPPRESS) or "default" in str(action.help)
        plain = isinstance(action.default, float | int | str | Path) and not isinstance(action.default, bool)
        return f"{action.help} (default %(default)s)" if plain and not stated else action.help


class Parser(argparse.ArgumentParser):
    """Parser that raises InputError, `argument: what is wrong; what to do`, and knows the nearest word to a typo."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options, allow_abbrev=False, formatter_class=HelpText)
        self.register("type", int, number(int))
        self.register("type", float, number(float))

    def parse(self, words: list[str]) -> argparse.Namespace:
        """Parse the words behind the command's name; the line as it was typed is in `typed`.

        Raises:
            InputError: An option that the command does not have, before all else; then whatever argparse refuses.
        """
        for word in words[:words.index("--") if "--" in words else None]:
            option = word.partition("=")[0]
            if option.startswith("--") and " " not in option and option not in self._option_string_actions:
                raise InputError(f"{option}: there is no such option{_nearest(option, self._option_string_actions)}")
        args = self.parse_args(words)
        args.typed = shlex.join([*self.prog.split(), *words])
        return args

    def error(self, message: str) -> NoReturn:
        """Raise argparse's message in the project's form."""
        found = ((re.fullmatch(pattern, message, re.DOTALL), text) for pattern, text in MESSAGES)
        raise InputError(next((text.format(*match.groups(), example=self.epilog) for match, text in found if match),
                              message))

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            raise argparse.ArgumentError(action, f"{value!r} is not a choice{_nearest(value, action.choices)}")


def _nearest(typed: str, known: Any) -> str:
    """Return `; did you mean ...?` for the nearest of the words, `; ` and all of them where none is near."""
    words = list(map(str, known))
    near = difflib.get_close_matches(typed, words, 1)
    return f"; did you mean {near[0]}?" if near else f"; give one of: {', '.join(words)}"


def load_module(command: Command) -> CommandModule:
    """Import the module behind a command."""
    return cast(CommandModule, import_module(command.module))


def make_parser(command: Command) -> Parser:
    """Return the parser of a command: description, example, and its options."""
    module = load_module(command)
    parser = Parser(prog=f"truearc {command.name}", description=module.__doc__, epilog=f"example: {module.EXAMPLE}")
    fill_parser(parser, module)
    return parser


def fill_parser(parser: argparse.ArgumentParser, module: CommandModule) -> None:
    """Add the arguments of a command to a parser that exists already."""
    if getattr(module, "PROGRESS", True):
        parser.add_argument("--quiet", action="store_true", help="no progress")
    module.add_arguments(parser)
    add_force(parser)
