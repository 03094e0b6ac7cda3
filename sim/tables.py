"""Tables of text cells as aligned columns for a terminal, and as CSV files."""

import csv
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from typing import Any

from truearc.errors import whole_file

Row = Sequence[str]


def make_text(header: Row, rows: Iterable[Row], right: Collection[int] = ()) -> list[str]:
    """Return lines of aligned columns, header first; right: columns of numbers, aligned at their end."""
    lines = [header, *rows]
    widths = [max(len(line[k]) for line in lines) for k in range(len(header))]
    return ["  ".join(cell.rjust(widths[k]) if k in right else cell.ljust(widths[k])
                      for k, cell in enumerate(line)).rstrip() for line in lines]


def save_csv(path: Path, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Write a CSV file in UTF-8, with "\\n" at the end of each line; OSError where it cannot be written."""
    with whole_file(path) as new, new.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)
