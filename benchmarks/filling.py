"""What benchmarks over worlds share: worlds are lines of a file, what is there is not run again, a table tells."""

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.archives import stored_file

from truearc.errors import InputError
from truearc_proof.rounds.jsonl_store import lines_of

Lines = dict[str, dict[str, Any]]


def parser_of(text: str | None) -> argparse.ArgumentParser:
    """A parser with where worlds are kept and how many run at a time; the benchmark adds its own arguments."""
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--processes", type=int, help="at a time (one a core)")
    place = parser.add_mutually_exclusive_group(required=True)
    place.add_argument("--out", metavar="FILE", help="where worlds are kept, a line each; none is run twice")
    place.add_argument("--table", type=stored_file, metavar="FILE", help="print what is there, run nothing")
    return parser


def fill_and_tell(args: argparse.Namespace, run_all: Callable[[Path], Lines],
                  make_table: Callable[[Sequence[dict[str, Any]]], str]) -> int:
    """Exit code; the table of all worlds of the file is printed. run_all: adds to a file what is not there yet."""
    path = Path(args.table or args.out)
    try:
        lines = run_all(path) if args.table is None else {line["key"]: line for line in lines_of(path)}
        if not lines:
            raise InputError(f"{path}: no world is in it")
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    print(make_table(list(lines.values())))
    return 0
