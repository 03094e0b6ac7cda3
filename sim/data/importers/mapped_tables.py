"""Tables of other people to a dataset by a map of their columns: a row a shot, or a row a position of one ball."""

import csv
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.shot_map import (
    MARKS,
    NOT_MARKED,
    ShotMap,
    Signal,
    as_signal,
    factor_of,
    own_unit,
    plain,
    unit_in,
)
from truearc.sim.data.columns import parse_number
from truearc.sim.data.dataset import Dataset
from truearc.sim.data.files import assemble
from truearc.sim.data.importers.logged_shots import as_read, as_table
from truearc.sim.data.table import Cell, RawTable, gathered, load_table, parse_csv, text_of

PLACE = re.compile(r"#(\d+)")         # a column by its number
MOST_TITLE = 20                       # lines of a title above the header, less one


def shots_from_tables(paths: Sequence[Path], shot_map: ShotMap, rig: Rig, name: str) -> Dataset:
    """Return the shots of tables under a map whose rows are shots, or positions of one ball a file.

    Raises:
        InputError: names file, line and column of what cannot be read, or a column of the map that is not there.
    """
    stems = [path.stem for path in paths]
    if len(set(stems)) < len(stems):
        raise InputError(f"two files are called {max(stems, key=stems.count)}: shot_id would not be unique")
    tables = [(path, _read(path, shot_map)) for path in paths]
    if shot_map.rows == "position":
        return _tracks(tables, shot_map, rig, name)
    rows: list[dict[str, Cell]] = []
    lines: list[int] = []
    left_out: list[str] = []
    for path, table in tables:
        more, at, odd = _shots(path, table, shot_map, rig)
        rows += more
        lines += at
        left_out += odd
    if not rows:
        raise InputError(f"{paths[0]}: there is no shot" + "".join(f"\n{line}" for line in left_out[:5]))
    with gathered() as problems:
        shots = as_table(rows, paths[0])
        dataset = assemble(name, rig, problems, shots if paths[1:] else replace(shots, lines=lines, in_memory=False))
    return replace(dataset, left_out=tuple(left_out))


def _read(path: Path, shot_map: ShotMap) -> RawTable:
    """The table below the line that has the map's columns; what stands before it is a title of the program's."""
    wanted = {as_signal(said).key for said in shot_map.columns.values()} | ({shot_map.outcome.key} - {""})
    names = {key for key in wanted if not PLACE.fullmatch(key)}
    found = table_below(path, lambda cells, after: names <= cells and (bool(names) or _is_data(after)))
    if found is None or not names <= set(found.columns):
        raise InputError(f"{path}:1: there is no line with the columns {', '.join(sorted(names))}")
    return found


def table_below(path: Path, is_header: Callable[[set[str], str], bool]) -> RawTable | None:
    """The table below the first line that is a header, by its cells and the line after it; None where none is."""
    if path.suffix == ".parquet":
        with gathered() as problems:
            return load_table(path, problems)
    lines = text_of(path).splitlines(keepends=True)
    for number in range(min(MOST_TITLE, len(lines))):
        if is_header(_header(lines[number:number + MOST_TITLE]), "".join(lines[number + 1:number + 2])):
            break
    else:
        return None
    width = len(_cells_of(lines[number]))
    for above, line in enumerate(lines[:number], 1):
        cells = _cells_of(line)
        if len(cells) == width and 2 * sum(parse_number(cell) is not None for cell in cells) > width > 1:
            raise InputError(f"{path}:{above}: a row of numbers stands above the header, which is line {number + 1}")
    with gathered() as problems:
        table = parse_csv("\n" * number + "".join(lines[number:]), path, problems)
    return replace(table, columns={name.strip(): cells for name, cells in table.columns.items()})


def _header(lines: list[str]) -> set[str]:
    """Cells of the first line, of any separator; a cell in quotes may go on in the next."""
    cells = set(_cells_of(lines[0]))
    for mark in ",;\t":
        with suppress(csv.Error):
            cells |= {cell.strip() for cell in next(csv.reader(lines, delimiter=mark), [])}
    return cells


def _cells_of(line: str) -> list[str]:
    """Cells of a line by any separator, where none is in quotes."""
    return [cell.strip().strip('"') for cell in re.split(r"[,;\t]", line.strip("\r\n"))]


def _is_data(line: str) -> bool:
    return all(parse_number(cell.strip().strip('"').replace(",", ".")) is not None
               for cell in re.split(r"[;\t]" if ";" in line or "\t" in line else ",", line.strip("\r\n")) if cell)


def _cells(table: RawTable, signal: Signal) -> list[Cell]:
    place = PLACE.fullmatch(signal.key)
    names = list(table.columns)
    if place and not 1 <= int(place[1]) <= len(names):
        raise InputError(f"{table.place(-1)}: there is no column {signal.key}; it has {len(names)}")
    return table.columns[names[int(place[1]) - 1] if place else signal.key]


def _column(table: RawTable, column: str, said: str | Signal) -> list[Cell]:
    """Cells of a column, numbers in its unit."""
    signal = as_signal(said)
    cells = _cells(table, signal)
    texts = [row for row, cell in enumerate(cells) if own_unit(column) and not _is_number(cell)]
    with gathered() as problems:
        problems += [f"{table.place(row)}: {signal.key}: {cells[row]!r} is not a number" for row in texts]
    if not own_unit(column) and (signal.times, signal.plus) == (1.0, 0.0):
        return cells
    stated = signal.unit or unit_in(signal.key)
    factor = factor_of(column, stated) if stated and own_unit(column) else (1.0, 0.0)
    if factor is None:
        raise InputError(f"{table.place(-1)}: {signal.key}: {stated!r} is not a unit of {column}; state unit = \"...\" "
                         "in the map")
    numbers = [parse_number(cell) for cell in cells]
    return [cell if number is None else (number * signal.times + signal.plus - factor[1]) * factor[0]
            for cell, number in zip(cells, numbers, strict=True)]


def _is_number(cell: Cell) -> bool:
    """Whether a cell is empty or a number."""
    return cell is None or not str(cell).strip() or parse_number(cell) is not None


def _shots(path: Path, table: RawTable, shot_map: ShotMap, rig: Rig
           ) -> tuple[list[dict[str, Cell]], list[int], list[str]]:
    """(a row a shot, the line of each, what was left out)."""
    columns: dict[str, list[Cell]] = {}
    for column, said in shot_map.columns.items():
        name, scale = as_read(column, rig)
        cells = _column(table, column, said)
        columns[name] = cells if scale == 1.0 else [None if number is None else number * scale
                                                    for number in map(parse_number, cells)]
    marks = _cells(table, Signal(shot_map.outcome.key)) if shot_map.outcome.key else None
    words = {plain(key): word for key, word in shot_map.outcome.values.items()}
    rows, lines, odd = list[dict[str, Cell]](), list[int](), list[str]()
    for row in range(len(table.lines)):
        shot: dict[str, Cell] = {"shot_id": f"{path.stem}-{row:04d}", "session": path.stem,
                                 **{column: cells[row] for column, cells in columns.items()}}
        if marks is not None:
            said = outcome_text(marks[row])
            if said not in words and not shot_map.outcome.otherwise:
                raise InputError(f"{table.place(row)}: {shot_map.outcome.key}: {marks[row]!r} is none of the map's "
                                 f"values ({', '.join(filter(None, shot_map.outcome.values))})")
            word = words.get(said, shot_map.outcome.otherwise)
            if word in NOT_MARKED:
                odd.append(f"{table.place(row)}: {'rejected' if said else 'no outcome'}")
                continue
            outcome, side = MARKS[word]
            shot["outcome"], shot["side"] = outcome or None, side or shot.get("side")
        rows.append(shot)
        lines.append(table.lines[row])
    return rows, lines, odd


def outcome_text(cell: Cell) -> str:
    """A cell of outcomes as maps compare it; "" for an empty one."""
    number = parse_number(cell)
    return "" if cell is None else plain(cell if number is None else number)


def _tracks(tables: list[tuple[Path, RawTable]], shot_map: ShotMap, rig: Rig, name: str) -> Dataset:
    """One shot a file; y_m = 0 where the map names none: filmed from the side."""
    if missing := [one for one in ("t_s", "x_m", "z_m") if one not in shot_map.columns]:
        raise InputError(f"the map has no columns.{missing[0]}: a row is a position, and that needs it")
    rows: list[dict[str, Cell]] = []
    for path, table in tables:
        columns = {column: _column(table, column, said) for column, said in shot_map.columns.items()}
        filled = [row for row in range(len(table.lines)) if all(cells[row] is not None for cells in columns.values())]
        rows += [{"shot_id": path.stem, "y_m": 0.0, **{column: cells[row] for column, cells in columns.items()}}
                 for row in filled]
    shots = [{"shot_id": path.stem} for path, _ in tables]
    with gathered() as problems:
        return assemble(name, rig, problems, as_table(shots, tables[0][0]), as_table(rows, tables[0][0]))
