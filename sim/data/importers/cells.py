"""Cells of a stranger's table -> columns, each bad one named by file, line and column."""

import math
from collections.abc import Sequence

import numpy as np

from truearc.robot.config.schema import InputError
from truearc.sim.data.columns import parse_number
from truearc.sim.data.model import Floats
from truearc.sim.data.problems import Problems
from truearc.sim.data.table import Table


def need_columns(table: Table, names: Sequence[str]) -> None:
    """InputError when a column is missing, naming the file and the column."""
    for name in names:
        if name not in table.columns:
            raise InputError(f"{table.place(-1)}: column {name} is missing")


def number_column(table: Table, name: str, problems: Problems, needed: bool = True) -> Floats:
    """A column of finite numbers; a cell that is none is a problem, as is an empty one where it is needed."""
    values = np.full(len(table.lines), np.nan)
    for row, cell in enumerate(table.columns[name]):
        number = parse_number(cell)
        if cell is None:
            if needed:
                problems.add(table.place(row), name, "is missing")
        elif number is None or not math.isfinite(number):
            problems.add(table.place(row), name, f"{cell!r} is not a finite number")
        else:
            values[row] = number
    return values


def text_column(table: Table, name: str, problems: Problems) -> list[str]:
    """A column of names; an empty cell is a problem."""
    for row, cell in enumerate(table.columns[name]):
        if cell is None:
            problems.add(table.place(row), name, "is missing")
    return ["" if cell is None else str(cell) for cell in table.columns[name]]
