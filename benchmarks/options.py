"""Options of a benchmark as a table: by name, each a default, or a default and what it is.

A default that is a type stands for none, False for a flag, ... for a path that must be given, [...] for one or more.
Nothing of the proof is imported here.
"""

import argparse
from pathlib import Path
from typing import Any


def read_options(text: str | None, **options: Any) -> argparse.Namespace:
    """Those of the command line."""
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    return add_options(parser, **options).parse_args()


def add_options(parser: argparse.ArgumentParser, **options: Any) -> argparse.ArgumentParser:
    for name, said in options.items():
        default, about = said if isinstance(said, tuple) else (said, None)
        if default in (..., [...]):
            parser.add_argument(name, type=Path, help=about, nargs="+" if default == [...] else None)
            continue
        kind = default if isinstance(default, type) else type(default)
        how: dict[str, Any] = {"action": "store_true"} if kind is bool else {
            "type": kind, "default": None if kind is default else default, "metavar": "FILE" if kind is Path else None}
        parser.add_argument(f"--{name}", help=about, **how)
    return parser
