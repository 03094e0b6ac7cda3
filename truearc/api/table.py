"""Tidy tables: one row per observation, plain Python values."""

import csv
import io
from dataclasses import dataclass
from typing import Any

from truearc.sim.printed import Printed, make_text


@dataclass(frozen=True)
class Table(Printed):
    """Rows under named columns.

    `columns`: their names, units at the end of a name. `rows`: one tuple per row, in the columns' order; None is a
    missing value.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]

    def __len__(self) -> int:
        return len(self.rows)

    def column(self, name: str) -> list[Any]:
        """Return the values of one column, a row each; ValueError for a name that the table does not have."""
        index = self.columns.index(name)
        return [row[index] for row in self.rows]

    def to_dict(self) -> dict[str, list[Any]]:
        """Return {column: values}, which pandas, polars and `truearc.dataset` take."""
        return {name: self.column(name) for name in self.columns}

    def to_csv(self) -> str:
        """Return the table as CSV text with a header; floats read back exactly, a missing value is empty."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerows([self.columns, *([_cell(cell) for cell in row] for row in self.rows)])
        return out.getvalue()

    def to_pandas(self) -> Any:
        """Return a pandas DataFrame; ModuleNotFoundError where pandas is not installed."""
        import pandas  # an option of the user's own: nothing here needs it
        return pandas.DataFrame(self.to_dict(), columns=list(self.columns))

    def lines(self) -> list[str]:
        """Return the table as aligned text, its header first."""
        return make_text(self.columns, [tuple(map(_text, row)) for row in self.rows])

    def _repr_html_(self) -> str:
        from truearc.sim.report import table
        return table(self.columns, self.rows)


def _cell(cell: Any) -> str:
    if cell is None or isinstance(cell, bool):
        return "" if cell is None else str(cell).lower()
    return repr(cell) if isinstance(cell, float) else str(cell)


def _text(cell: Any) -> str:
    if cell is None:
        return ""
    return f"{cell:.4g}" if isinstance(cell, float) else str(cell)
