"""Numbers in other people's program text -> a table, so that the public original itself can be imported."""

import json
import math
import re
from collections.abc import Sequence
from pathlib import Path

from robot.config import BadInput
from sim.dataset.columns import parse_number
from sim.dataset.table import Cell, Table, text_of

INCH_M = 0.0254


def matching(path: Path, pattern: str) -> Table:
    """A row for each match of the pattern outside comments (C++, Java); its named groups are the columns.

    Let the groups take whatever stands where a number should, so that what is none is named and not passed over.
    BadInput where nothing matches.
    """
    code = re.sub(r"/\*.*?\*/|//[^\n]*", lambda found: "\n" * found[0].count("\n"), text_of(path), flags=re.DOTALL)
    matches = list(re.finditer(pattern, code))
    if not matches:
        raise BadInput(f"{path}: holds no numbers where they are looked for (docs/importing.md says which file it is)")
    columns: dict[str, list[Cell]] = {name: [match[name].strip() or None for match in matches]
                                      for name in re.compile(pattern).groupindex}
    return Table(path, columns, [code.count("\n", 0, match.start()) + 1 for match in matches])


def json_rows(path: Path, key: str, names: Sequence[str]) -> Table:
    """The list of objects under `key`, one a row, each with all `names`; a row's line is that of its first name.

    BadInput when it is not there.
    """
    text = text_of(path)
    try:
        rows = json.loads(text)[key]
        cells = {name: [row[name] for row in rows] for name in names}
    except (ValueError, KeyError, TypeError) as error:
        raise BadInput(f"{path}: has no list {key!r} of objects with {', '.join(names)} ({error})") from error
    lines = [text.count("\n", 0, match.start()) + 1 for match in re.finditer(f'"{re.escape(names[0])}"', text)]
    columns: dict[str, list[Cell]] = {name: [cell if isinstance(cell, float) else str(cell) for cell in column]
                                      for name, column in cells.items()}
    return Table(path, columns, lines)


def scaled(cells: Sequence[Cell], factor: float) -> list[Cell]:
    """Cells in another unit; one that is no number stays as it is, to be named."""
    numbers = [parse_number(cell) for cell in cells]
    return [cell if number is None or not math.isfinite(number) else number * factor
            for cell, number in zip(cells, numbers, strict=True)]
