"""The command line: finds the command, imports its module, and turns errors into messages and exit codes."""

import difflib
import os
import sys

import truearc
from truearc.cli import commands
from truearc.cli.commands import Command, find_command, list_commands, make_parser
from truearc.cli.outputs import fresh_outputs
from truearc.errors import ELSEWHERE, InputError, needs

# Arrays here are small: threads of the linear algebra would only wait for one another and, where another process keeps
# a core busy, for that. Set before NumPy is imported.
ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
PREFIXES = {name.partition(" ")[0] for name in commands.NAMES} - set(commands.NAMES)


def main(argv: list[str] | None = None) -> int:
    """Run one command; return 0 done, 1 a check failed, 2 bad input."""
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
        print(f"truearc {command.name}: needs {error.name}, which is not installed: {commands.install_hint(command)}",
              file=sys.stderr)
        return 2


def _run(command: Command, words: list[str]) -> int:
    try:
        parser = make_parser(command)
        args = parser.parse(words)
        with fresh_outputs(parser, args):
            code = int(command.load().main(args))
        sys.stdout.flush()
        return code
    except InputError as error:
        print(f"truearc {command.name}: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:
        return _unread()
    except OSError as error:          # a place that cannot be read or written
        where = "" if error.filename is None else f"{error.filename}: "
        print(f"truearc {command.name}: {where}{error.strerror or error}", file=sys.stderr)
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
    among = commands.COMMANDS if prefix else list_commands()
    listed = [command for command in among if command.name.startswith(f"{prefix} ".lstrip())]
    lines = [f"usage: truearc {f'{prefix} '.lstrip()}COMMAND ...   (truearc COMMAND --help explains its options)"]
    for group in dict.fromkeys([*commands.GROUPS, *(command.group for command in listed)]):
        members = [command for command in listed if command.group == group]
        if members:
            lines += ["", f"{group}: {commands.GROUPS[group]}" if group in commands.GROUPS else f"{group}:"]
            lines += [f"  {command.name:17s} {command.summary}" for command in members]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
