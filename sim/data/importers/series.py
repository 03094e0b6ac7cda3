"""Signals of robot logs as series of samples, and CSV exports of log viewers as such."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from truearc.errors import InputError
from truearc.sim.data.columns import parse_number
from truearc.sim.data.dataset import Floats
from truearc.sim.data.table import Cell, RawTable, gathered, load_table

BACK_US = 1_000_000                   # a signal's values of several writers may be out of order by less
TRUE, FALSE = "true", "false"
TIME, KEY, VALUE = "Timestamp", "Key", "Value"          # header of AdvantageScope's CSV list


@dataclass(frozen=True)
class Series:
    """One signal: times [n] in s, not falling; values [n], numbers or texts; the unit that the log states, or "".

    A boolean is 1 or 0. `each_row`: a value stands at every time of the log, whether it is new or not.
    """

    name: str
    t_s: Floats
    values: Floats | tuple[str, ...]
    unit: str = ""
    each_row: bool = False

    @property
    def numeric(self) -> bool:
        return isinstance(self.values, np.ndarray)

    def before(self, t_s: float) -> float | str | None:
        """The newest value at that time or before; None where there is none yet."""
        place = int(np.searchsorted(self.t_s, t_s, side="right")) - 1
        return None if place < 0 or self.values[place] == "" else self.values[place]

    def changes(self) -> "Series":
        """Without samples that repeat the one before."""
        if len(self.t_s) < 2:
            return self
        values = self.values if isinstance(self.values, np.ndarray) else np.array(self.values, dtype=object)
        new = np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1]]))
        kept = self.values[new] if isinstance(self.values, np.ndarray) else tuple(values[new])
        return Series(self.name, self.t_s[new], kept, self.unit)


Signals = Mapping[str, Series]


class Log(dict[str, Series]):
    """The signals of a log by their names; `damage`: a line for each kind of damage to its file."""

    def __init__(self, signals: Signals, damage: tuple[str, ...] = ()) -> None:
        super().__init__(signals)
        self.damage = damage


def read_csv_log(path: Path, time: str | None, second: float) -> Log:
    """Signals of a CSV file: AdvantageScope's list (Timestamp, Key, Value), or a table with a column a signal.

    time: the column of time; None: `Timestamp`. second: how many of its units are one.

    Raises:
        InputError: a cell of the time is not a number, or the column is missing.
    """
    with gathered() as problems:
        table = load_table(path, problems)
    column = TIME if time is None else time
    if column not in table.columns:
        raise InputError(f"{table.place(-1)}: there is no column {column!r} of time ({', '.join(table.columns)})")
    t_s = np.array([_time(table, row, cell) for row, cell in enumerate(table.columns[column])]) / second
    if {KEY, VALUE} <= set(table.columns):
        return _of_list(table, t_s)
    return Log({name: series for name, cells in table.columns.items()
                if name != column and (series := _of_cells(name, t_s, cells, each_row=True)) is not None},
               _backwards([t_s]))


def _time(table: RawTable, row: int, cell: Cell) -> float:
    number = parse_number(cell)
    if number is None or not np.isfinite(number):
        raise InputError(f"{table.place(row)}: {cell!r} is not a time")
    return number


def _of_list(table: RawTable, t_s: Floats) -> Log:
    rows: dict[str, list[int]] = {}
    for row, key in enumerate(table.columns[KEY]):
        rows.setdefault(str(key or ""), []).append(row)
    cells = table.columns[VALUE]
    found = {key: _of_cells(key, t_s[mine], [cells[row] for row in mine]) for key, mine in rows.items()}
    return Log({key: series for key, series in found.items() if series is not None},
               _backwards([t_s[mine] for mine in rows.values()]))


def _backwards(times: list[Floats]) -> tuple[str, ...]:
    """A line on how often time goes back in series of rows, as where a part of the file stands in another's place."""
    count = sum(np.count_nonzero(np.diff(t_s) < -BACK_US * 1e-6) for t_s in times)
    return (f"damaged: time goes back in {count} rows; shots may be missing",) if count else ()


def _of_cells(name: str, t_s: Floats, cells: list[Cell], each_row: bool = False) -> Series | None:
    """Numbers where every cell that is filled is one, or a boolean."""
    filled = [row for row, cell in enumerate(cells) if cell is not None and str(cell).strip() not in ("", "null")]
    if not filled:
        return None
    order = sorted(filled, key=lambda row: t_s[row])
    numbers = [_number(cells[row]) for row in order]
    if any(number is None for number in numbers):
        order = sorted(range(len(cells)), key=lambda row: t_s[row]) if each_row else order     # "" is a word, too
        return Series(name, t_s[order], tuple(str(cells[row] or "").strip() for row in order), "", each_row)
    return Series(name, t_s[order], np.array(numbers, dtype=float), "", each_row)


def _number(cell: Cell) -> float | None:
    word = str(cell).strip().lower()
    return 1.0 if word == TRUE else 0.0 if word == FALSE else parse_number(cell)
