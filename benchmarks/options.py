"""Command-line options of a benchmark, declared by name with a default, or with a default and a help text.

Special defaults: a type for an option without a default, False for a flag, ... for a required path, and [...] for one
or more required paths. This module imports nothing from the proof.
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
