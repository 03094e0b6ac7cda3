"""Print a completion script for a shell, made from the parsers of the installed commands.

bash: put the line of the example into ~/.bashrc; zsh: write the script to a file `_truearc` in a folder of $fpath;
tcsh: source the script in ~/.tcshrc.
"""

import argparse

from truearc.cli.parsers import fill_parser, load_module
from truearc.cli.registry import GROUPS, Command, list_commands

EXAMPLE = 'eval "$(truearc completion bash)"'
PROGRESS = False
SHELLS = ("bash", "zsh", "tcsh")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("shell", choices=SHELLS, help="shell to complete in")


def main(args: argparse.Namespace) -> int:
    """Return 0 when the script is printed."""
    import shtab
    print(shtab.complete(make_root_parser(list_commands()), args.shell))
    return 0


def make_root_parser(commands: tuple[Command, ...]) -> argparse.ArgumentParser:
    """Return one parser that has every command as a subcommand, to be read by shtab; it parses no command line."""
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
                fill_parser(second.add_parser(last, help=command.summary), load_module(command))
        if own:
            fill_parser(parser, load_module(own))
    return root
