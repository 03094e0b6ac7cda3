"""Tables of text cells as Markdown, as aligned columns for a terminal, and as CSV files. Standard library only."""

import csv
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

Row = Sequence[str]


class Table(NamedTuple):
    """A title, a header, rows of as many cells, and what a reader must know of them."""

    title: str
    header: tuple[str, ...]
    rows: Sequence[Row]
    note: str = ""

    def markdown(self) -> str:
        """Return a heading of the third level and the table."""
        return f"### {self.title}\n\n{make_markdown(self.header, self.rows)}"

    def text(self) -> str:
        """Return a blank line, the title and the table for a terminal."""
        return "\n".join(["", self.title, *make_text(self.header, self.rows)])


def make_markdown(header: Row, rows: Iterable[Row]) -> str:
    """Return a Markdown table."""
    lines = [f"| {' | '.join(row)} |" for row in (header, *rows)]
    return "\n".join([lines[0], "|" + "---|" * len(header), *lines[1:]])


def make_text(header: Row, rows: Iterable[Row], right: Collection[int] = ()) -> list[str]:
    """Return lines of aligned columns, header first; right: columns of numbers, aligned at their end."""
    lines = [header, *rows]
    widths = [max(len(line[k]) for line in lines) for k in range(len(header))]
    return ["  ".join(cell.rjust(widths[k]) if k in right else cell.ljust(widths[k])
                      for k, cell in enumerate(line)).rstrip() for line in lines]


def save_csv(path: Path, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Write a CSV file in UTF-8, with "\\n" at the end of each line; OSError where it cannot be written."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)
