"""Dispatch of the command line: the table of commands, parsers, completion, and the messages and exit codes of errors.

Listing the commands imports none of them, because `commands.toml` describes truearc's own commands.
"""

import argparse
import difflib
import os
import re
import shlex
import sys
import tomllib
from collections.abc import Callable
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import truearc
from truearc.cli.common import add_force, fresh_outputs, number
from truearc.cli.file_kinds import misplaced
from truearc.errors import ELSEWHERE, INSTALL_HINTS, InputError, needs

ENTRY_POINTS = "truearc.commands"
OTHER_GROUP = "other"                 # of a command from another distribution that names no group
# argparse's messages -> the project's; {0}, {1}: groups of the pattern, {example}: the command's example
MESSAGES = (
    (r"argument (.+?): expected .*argument.*", "{0}: its value is missing; {example}"),
    (r"argument (.+?): not allowed with argument (.+)", "{0}: excludes {1}; give one of them"),
    (r"argument (.+?): ignored explicit argument (.+)", "{0}: takes no value, got {1}; leave it out"),
    (r"argument (.+)", "{0}"),
    (r"the following arguments are required: (.+)", "{0}: missing; {example}"),
    (r"unrecognized arguments: (.+)", "{0}: not an argument of this command; {example}"),
)
SHELLS = ("bash", "zsh", "tcsh")


class Command(NamedTuple):
    """A command.

    Fields:
        name: The words that call it, such as `fit` or `paper fit`.
        run: `module:function`; the function takes the parsed arguments and returns the exit code (0 done, 1 a check
            failed; InputError on bad input), its docstring is the description in `--help`, and `function_options` adds
            its options to a parser. Of another distribution a module with a docstring, main(args) and
            add_arguments(parser). Importing either loads no numerical library.
        group: The heading of `truearc --help` that lists it; a key of GROUPS, or another distribution's own.
        summary: One line for that list.
        example: A line to type.
        progress: Whether it shows progress, and so has `--quiet`.
        distribution: What to install where a package is missing; empty for truearc itself.
    """

    name: str
    run: str
    group: str
    summary: str
    example: str = ""
    progress: bool = True
    distribution: str = ""

    def load(self) -> "Loaded":
        """Import the code behind the command."""
        place, _, function = self.run.partition(":")
        module = import_module(place)
        if not function:
            return Loaded(module.main, module.add_arguments, module.__doc__ or "")
        main = getattr(module, function)
        return Loaded(main, getattr(module, f"{function}_options"), main.__doc__ or "")


class Loaded(NamedTuple):
    """The code of a command, and its description."""

    main: Callable[[argparse.Namespace], int]
    add_options: Callable[[argparse.ArgumentParser], None]
    description: str


_TABLE = tomllib.loads(Path(__file__).with_name("commands.toml").read_text(encoding="utf-8"))
GROUPS: dict[str, str] = _TABLE["groups"]         # name -> what its commands are about
COMMANDS = tuple(Command(**row) for row in _TABLE["command"])
NAMES = {command.name: command for command in COMMANDS}


def find_command(argv: list[str]) -> Command | None:
    """Return the command at the start of `argv`, two words before one; None if there is none."""
    words = [" ".join(argv[:2]), *argv[:1]]
    own = next((NAMES[word] for word in words if word in NAMES), None)
    if own is not None or not argv or argv[0].startswith("-"):
        return own
    return next((command for word in words for command in load_plugins() if command.name == word), None)


@cache
def load_plugins() -> tuple[Command, ...]:
    """Return the commands of other distributions, from the entry points `truearc.commands`, sorted by name.

    Each names a module (see `Command.run`) that also has EXAMPLE, SUMMARY, GROUP where it wants a heading of its own,
    and `PROGRESS = False` where it shows none. A module that cannot be imported is listed with the reason, so that the
    other commands go on working.
    """
    plugins = []
    for point in sorted(entry_points(group=ENTRY_POINTS), key=lambda point: point.name):
        distribution = point.dist.name if point.dist else ""
        try:
            module = import_module(point.value)
            group, summary, example = getattr(module, "GROUP", OTHER_GROUP), module.SUMMARY, module.EXAMPLE
            progress = getattr(module, "PROGRESS", True)
        except (ImportError, AttributeError) as error:
            group, summary, example, progress = OTHER_GROUP, f"cannot be loaded: {error}", "", False
        plugins.append(Command(point.name, point.value, group, summary, example, progress, distribution))
    return tuple(plugins)


def list_commands() -> tuple[Command, ...]:
    """Return every command that is installed: truearc's own, then those of other distributions."""
    return (*COMMANDS, *load_plugins())


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
                raise InputError(f"{option}: there is no such option{_near_words(option, self._option_string_actions)}")
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
            raise argparse.ArgumentError(action, f"{value!r} is not a choice{_near_words(value, action.choices)}")


def _near_words(typed: str, known: Any) -> str:
    """Return `; did you mean ...?` for the nearest of the words, `; ` and all of them where none is near."""
    words = list(map(str, known))
    near = difflib.get_close_matches(typed, words, 1)
    return f"; did you mean {near[0]}?" if near else f"; give one of: {', '.join(words)}"


def make_parser(command: Command) -> Parser:
    """Return the parser of a command: description, example, and its options."""
    parser = Parser(prog=f"truearc {command.name}", description=command.load().description,
                    epilog=f"example: {command.example}")
    fill_parser(parser, command)
    return parser


def fill_parser(parser: argparse.ArgumentParser, command: Command) -> None:
    """Add the arguments of a command to an existing parser."""
    if command.progress:
        parser.add_argument("--quiet", action="store_true", help="no progress")
    command.load().add_options(parser)
    add_force(parser)


def completion_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("shell", choices=SHELLS, help="shell to complete in")


def completion(args: argparse.Namespace) -> int:
    """Print a completion script for a shell, made from the parsers of the installed commands.

    bash: put the line of the example into ~/.bashrc; zsh: write the script to a file `_truearc` in a folder of $fpath;
    tcsh: source the script in ~/.tcshrc.
    """
    import shtab
    print(shtab.complete(make_root_parser(list_commands()), args.shell))
    return 0


def make_root_parser(commands: tuple[Command, ...]) -> argparse.ArgumentParser:
    """Return one parser with every command as a subcommand, for shtab; it parses no command line."""
    root = argparse.ArgumentParser(prog="truearc")
    root.add_argument("--version", action="store_true", help="print the version")
    first = root.add_subparsers()
    for word in dict.fromkeys(command.name.split()[0] for command in commands):
        members = {one.name.removeprefix(word).strip(): one for one in commands if one.name.split()[0] == word}
        own = members.pop("", None)
        parser = first.add_parser(word, help=own.summary if own else GROUPS.get(word))
        if members:
            second = parser.add_subparsers()
            for last, command in members.items():
                fill_parser(second.add_parser(last, help=command.summary), command)
        if own:
            fill_parser(parser, own)
    return root


# --- running a command

# Arrays here are small: threads of the linear algebra would only wait for one another and, where another process keeps
# a core busy, for that. Set before NumPy is imported.
ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
PREFIXES = {name.partition(" ")[0] for name in NAMES} - set(NAMES)


def main(argv: list[str] | None = None) -> int:
    """Run one command; return 0 for success, 1 if a check failed, 2 for bad input."""
    for name in ONE_THREAD:
        os.environ.setdefault(name, "1")
    argv = list(sys.argv[1:] if argv is None else argv)
    if argv == ["--version"]:
        print(f"truearc {truearc.__version__}")
        return 0
    command = find_command(argv)
    if command is None:
        return _explain(argv)
    try:
        return _run(command, argv[len(command.name.split()):])
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package in ("", "truearc", "truearc_proof", "truearc_frc"):
            raise                     # ours: a defect, not an install without the companion
        hint = INSTALL_HINTS.get(command.distribution, f"pip install '{command.distribution or 'truearc[sim]'}'")
        print(f"truearc {command.name}: needs {error.name}, which is not installed: {hint}", file=sys.stderr)
        return 2


def _run(command: Command, words: list[str]) -> int:
    args = argparse.Namespace()
    try:
        parser = make_parser(command)
        args = parser.parse(words)
        if message := misplaced(command.name, args):
            raise InputError(message)
        with fresh_outputs(parser, args):
            code = int(command.load().main(args))
        sys.stdout.flush()
        return code
    except InputError as error:
        print(f"truearc {command.name}: {misplaced(command.name, args, str(error)) or error}", file=sys.stderr)
        return 2
    except BrokenPipeError:
        return _unread()
    except OSError as error:          # a place that cannot be read or written
        where = "" if error.filename is None else f"{error.filename}: "
        message = f"{where}{error.strerror or error}"
        print(f"truearc {command.name}: {misplaced(command.name, args, message) or message}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130


def _unread() -> int:
    """Whoever read our output has had enough, as `head` does: nothing more goes there."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


def _explain(argv: list[str]) -> int:
    """Answer words that begin with no command: a list where one was asked for, else what may have been meant."""
    prefix = argv[0] if argv and argv[0] in PREFIXES else ""
    words = argv[1:] if prefix else argv
    if words and words[0] in ("-h", "--help"):
        try:
            print(_list(prefix), flush=True)
        except BrokenPipeError:
            return _unread()
        return 0
    if not words:
        print(_list(prefix), file=sys.stderr)
        return 2
    if argv[0] in ELSEWHERE:
        print(f"truearc {argv[0]}: {needs(argv[0])}", file=sys.stderr)
        return 2
    typed = f"{prefix} {words[0]}".strip()
    near = _nearest(typed)
    hint = f"; did you mean: {' or '.join(f'truearc {name}' for name in near)}?" if near else f"\n\n{_list(prefix)}"
    print(f"truearc: {typed}: not a command{hint}", file=sys.stderr)
    return 2


def _nearest(typed: str) -> list[str]:
    """The commands whose name, or whose last word, is nearest to what was typed, nearest first; at most two."""
    names = [command.name for command in list_commands()]
    meant = {name.rpartition(" ")[2]: name for name in reversed(names)} | {name: name for name in names}
    return list(dict.fromkeys(meant[word] for word in difflib.get_close_matches(typed, meant, 2)))


def _list(prefix: str) -> str:
    """Every command under the heading of its group; those of one prefix where there is one."""
    among = COMMANDS if prefix else list_commands()
    listed = [command for command in among if command.name.startswith(f"{prefix} ".lstrip())]
    lines = [f"usage: truearc {f'{prefix} '.lstrip()}COMMAND ...   (truearc COMMAND --help explains its options)"]
    for group in dict.fromkeys([*GROUPS, *(command.group for command in listed)]):
        members = [command for command in listed if command.group == group]
        if members:
            lines += ["", f"{group}: {GROUPS[group]}" if group in GROUPS else f"{group}:"]
            lines += [f"  {command.name:17s} {command.summary}" for command in members]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
