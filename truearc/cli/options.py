"""Options that apply in some modes of a command only."""

import argparse

from truearc.robot.config.schema import InputError


def refuse(args: argparse.Namespace, options: tuple[str, ...], why: str) -> None:
    """Refuse options that do not apply, so that none is ignored.

    Args:
        args: Parsed arguments; the options default to None, False or an empty list.
        options: As typed, such as `--tape-sigma`; the attribute of `args` follows from it.
        why: The rest of the message, such as `applies with --distances only`.

    Raises:
        InputError: One of the options was given; the message names it.
    """
    for option in options:
        if getattr(args, option.lstrip("-").replace("-", "_")) not in (None, False, []):
            raise InputError(f"{option}: {why}")
