"""Helpers for importers: readers of original public files, such as numbers in program text, and names of file parts."""

import json
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from truearc.errors import InputError
from truearc.sim.data.dataset import Tracks
from truearc.sim.data.table import Cell, Problems, RawTable, parse_number, text_of

Key = TypeVar("Key")
INCH_M = 0.0254
C_COMMENT = r"/\*.*?\*/|//[^\n]*"       # C++ and Java


def matching(path: Path, pattern: str, within: str = r".*") -> RawTable:
    """Return a row for each match of the pattern outside comments; its named groups are the columns.

    within: location of the table in the program text; the first match counts.

    Groups should accept any text in place of a number, so that an invalid one is named, not passed over. InputError if
    nothing matches.
    """
    code = re.sub(C_COMMENT, lambda found: "\n" * found[0].count("\n"), text_of(path), flags=re.DOTALL)
    table = re.search(within, code, flags=re.DOTALL)
    matches = list(re.compile(pattern).finditer(code, *table.span())) if table else []
    if not matches:
        raise InputError(f"{path}: holds no numbers where expected (proof/IMPORTERS.md says which file it "
                         f"is)")
    columns: dict[str, list[Cell]] = {name: [match[name].strip() or None for match in matches]
                                      for name in re.compile(pattern).groupindex}
    return RawTable(path, columns, [code.count("\n", 0, match.start()) + 1 for match in matches])


def json_rows(text: str, path: Path, key: str, names: Sequence[str]) -> RawTable:
    """Return the list of objects under `key`, one per row, each with all `names`; a row's line is that of its first
    name.

    InputError if it is missing.
    """
    try:
        rows = json.loads(text)[key]
        cells = {name: [row[name] for row in rows] for name in names}
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError(f"{path}: has no list {key!r} of objects with {', '.join(names)} ({error})") from error
    lines = [text.count("\n", 0, match.start()) + 1 for match in re.finditer(f'"{re.escape(names[0])}"', text)]
    columns: dict[str, list[Cell]] = {name: [cell if isinstance(cell, float) else str(cell) for cell in column]
                                      for name, column in cells.items()}
    return RawTable(path, columns, lines[:len(rows)])


def scaled(cells: Sequence[Cell], factor: float) -> list[Cell]:
    """Convert cells, or products of numbers such as `4.0 * 12.0`, to another unit; an invalid cell stays, to be
    named."""
    numbers = [_product(cell) for cell in cells]
    return [cell if number is None or not math.isfinite(number) else number * factor
            for cell, number in zip(cells, numbers, strict=True)]


def _product(cell: Cell) -> float | None:
    factors = [parse_number(part) for part in cell.split("*")] if isinstance(cell, str) else [parse_number(cell)]
    known = [factor for factor in factors if factor is not None]
    return math.prod(known) if len(known) == len(factors) else None


def group_rows(keys: Sequence[Key], t_s: np.ndarray, table: RawTable, problems: Problems, what: str
               ) -> dict[Key, list[int]]:
    """Group rows by key, in order of first appearance; times must increase within a group. what: what a key
    identifies."""
    rows_of: dict[Key, list[int]] = {}
    for row, key in enumerate(keys):
        rows = rows_of.setdefault(key, [])
        if rows and t_s[row] <= t_s[rows[-1]]:
            problems.add(table.place(row), "t_s", f"does not follow the sample before of the same {what}")
        rows.append(row)
    return rows_of


def tracks_of(samples: Sequence[np.ndarray]) -> Tracks:
    """Return tracks of shots, each of samples [k, 4]: t_s x_m y_m z_m."""
    stacked = np.concatenate(samples) if samples else np.zeros((0, 4))
    return Tracks(np.repeat(np.arange(len(samples)), [len(one) for one in samples]), *stacked.T)


def part(path: Path, name: str) -> Path:
    """Return how messages name a part of a file: such as a group."""
    return Path(f"{path}, {name}")
