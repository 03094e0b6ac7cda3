"""CSV and Parquet files -> cells in columns, each row knowing where it came from; and everything wrong with them,
gathered, so that one run names it all."""

import csv
import io
import re
import sys
from codecs import BOM_UTF8
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from truearc.errors import MAX_BYTES, InputError, load_bytes

DECIMAL_COMMA = re.compile(r"^\s*([+-]?\d+),(\d+)\s*$")
THOUSANDS = re.compile(r"^\s*[+-]?[1-9]\d{0,2},\d{3}\s*$")
DECIMAL_POINT = re.compile(r"^\s*[+-]?\d*\.\d+\s*$")
Cell = str | float | None             # CSV gives text; Parquet numbers, text or None
# Of a Parquet file: a column of one value has any length in a few bytes, one of measured numbers takes bytes for each.
MOST_CELLS, CELLS_PER_BYTE = 2_000_000, 20
SHOWN = 20                            # problems a message lists before it only counts


class Problems(list[str]):
    """Messages, each with its place."""

    def add(self, place: str, column: str, what: str) -> None:
        """place: file and line; column: name, or '' when it is the row."""
        self.append(f"{place}: {column}: {what}" if column else f"{place}: {what}")

    def close(self) -> None:
        """Raise InputError with the first problems and how many there are, if there are any."""
        more = len(self) - SHOWN
        tail = [f"... and {more} more problems ({len(self)} in all)"] if more > 0 else []
        if self:
            raise InputError("\n".join(self[:SHOWN] + tail))


@contextmanager
def gathered() -> Iterator[Problems]:
    """Problems that are raised together at the end of the block."""
    problems = Problems()
    try:
        yield problems
    except InputError as error:
        problems.append(str(error))
    problems.close()


@dataclass(frozen=True)
class RawTable:
    """`columns`: name -> one cell a row, None = missing; `lines`: line (CSV) or row (else) of each, from 1.

    `in_memory`: not read from a file; `path` is then the name of the argument. `written`: of columns that are
    read as others, name -> (name in the file, how many of the column's unit are one of the file's, its zero).
    """

    path: Path
    columns: dict[str, list[Cell]]
    lines: list[int]
    in_memory: bool = False
    written: dict[str, tuple[str, float, float]] = field(default_factory=dict)

    def converted(self, name: str) -> bool:
        """Whether a column's numbers have another unit in the file."""
        return self.written.get(name, ("", 1.0, 0.0))[1:] != (1.0, 0.0)

    def shown(self, name: str, number: float) -> str:
        """A number of a column as the file has it."""
        _, factor, zero = self.written.get(name, ("", 1.0, 0.0))
        return f"{number / factor + zero:g}"

    def fault(self, problems: Problems, row: int, name: str, what: str) -> None:
        """Add a problem of a cell, or of the header (row -1), with the column's name as the file has it."""
        problems.add(self.place(row), self.written.get(name, (name,))[0], what)

    def place(self, row: int) -> str:
        """File and line as messages name them; row -1 is the header."""
        if self.in_memory or self.path.suffix == ".parquet":
            return f"{self.path}: row {self.lines[row]}" if row >= 0 else f"{self.path}"
        return f"{self.path}:{self.lines[row] if row >= 0 else 1}"


def find_table(directory: Path, stem: str) -> Path | None:
    """The CSV or Parquet file of that name, None when there is neither; InputError when there are both."""
    found = [path for path in (directory / f"{stem}.csv", directory / f"{stem}.parquet")
             if path.exists() or path.is_symlink()]
    for path in found:
        if not path.is_file():
            raise InputError(f"{path}: is not a file")
    if len(found) > 1:
        raise InputError(f"{directory}: has both {stem}.csv and {stem}.parquet; keep one")
    return found[0] if found else None


def load_table(path: Path, problems: Problems) -> RawTable:
    """Read a table; rows of a wrong length become problems, an unreadable file is InputError."""
    return _load_parquet(path) if path.suffix == ".parquet" else parse_csv(text_of(path), path, problems)


def parse_csv(text: str, path: Path, problems: Problems) -> RawTable:
    """Cells of CSV text with a header; empty cells are None. Blank lines, and empty columns behind the last that has a
    name, are skipped."""
    mark = _separator(text, path)
    rows = _rows(text, path, mark)
    top, header = next(rows, (1, []))
    width = len(header)
    while header and not header[-1].strip():              # spreadsheets write empty columns behind the last
        header.pop()
    if not header:
        raise InputError(f"{path}:{top}: the header is missing")
    for name in header:
        if not name.strip() or header.count(name) > 1:
            raise InputError(f"{path}:{top}: column {name!r} " + ("stands twice" if name.strip() else "is unnamed"))
    columns: dict[str, list[Cell]] = {name: [] for name in header}
    lines = []
    for line, cells in rows:
        if not any(map(str.strip, cells)):
            continue
        beyond = "".join(cells[len(header):]).strip()
        if beyond and len(cells) <= width:
            raise InputError(f"{path}:{top}: column '' is unnamed, and has {beyond!r} in line {line}; name it")
        if beyond or len(cells) < len(header):
            problems.add(f"{path}:{line}", "", f"{len(cells)} cells where the header has {len(header)}; a cell with "
                         "a comma in it stands in quotes, an empty one needs its comma, too")
            continue
        lines.append(line)
        for name, cell in zip(header, cells, strict=False):
            columns[name].append(cell or None)
    return RawTable(path, _with_points(columns, path), lines)


def _with_points(columns: dict[str, list[Cell]], path: Path) -> dict[str, list[Cell]]:
    """Decimal commas as points, in columns without points where some comma cannot be of thousands; in a table without
    any point also where each could be."""
    cells = {name: [str(cell) for cell in column if cell] for name, column in columns.items()}
    commas = {name: [cell for cell in column if DECIMAL_COMMA.match(cell)] for name, column in cells.items()}
    pointed = {name for name, column in cells.items() if any(map(DECIMAL_POINT.match, column))}
    sure = {name for name, found in commas.items() if not all(map(THOUSANDS.match, found))}
    read = [name for name, found in commas.items()
            if found and name not in pointed and (name in sure or (sure and not pointed))]
    if not read:
        return columns
    print(f"warning: {path}: read with commas as decimal points: {', '.join(read)}", file=sys.stderr)
    return {name: [cell and DECIMAL_COMMA.sub(r"\1.\2", str(cell)) for cell in column] if name in read else column
            for name, column in columns.items()}


def _separator(text: str, path: Path) -> str:
    """Spreadsheets of many countries write semicolons, and then commas for decimal points; others tabs."""
    header = text.lstrip("\r\n").partition("\n")[0]
    for mark, name in ((";", "semicolons"), ("\t", "tabs")):
        if mark in header and "," not in header:
            print(f"warning: {path}: read with {name} between cells", file=sys.stderr)
            return mark
    return ","


def _rows(text: str, path: Path, mark: str) -> Iterator[tuple[int, list[str]]]:
    """(line on which the row starts, its cells), without blank lines."""
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=mark, strict=True)
    while True:
        line = reader.line_num + 1
        try:
            cells = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            raise InputError(f"{path}:{line}: {error}") from error
        if cells:
            yield line, cells


def text_of(path: Path) -> str:
    """A text file; InputError names it, and the line that is not UTF-8."""
    data = load_bytes(path)
    if data.startswith(BOM_UTF8):
        print(f"warning: {path}: read without the byte-order mark that it begins with", file=sys.stderr)
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise InputError(f"{path}:{line}: not UTF-8 text; save the table as UTF-8 (in a spreadsheet: CSV UTF-8)"
                         ) from error


def _load_parquet(path: Path) -> RawTable:
    try:
        with pq.ParquetFile(path) as file:
            said = file.metadata
            groups = [said.row_group(number) for number in range(said.num_row_groups)]
            cells, size = said.num_rows * said.num_columns, sum(group.total_byte_size for group in groups)
            if size > MAX_BYTES or cells > max(MOST_CELLS, CELLS_PER_BYTE * path.stat().st_size):
                raise InputError(f"{path}: unpacks to {cells} cells of {size} bytes; more than is read of such a file")
            table = file.read()
        names = table.column_names
        if len(set(names)) < len(names):
            raise InputError(f"{path}: a column stands twice")
        columns = {name: [as_cell(value) for value in table.column(name).to_pylist()] for name in names}
    except (OSError, ValueError, OverflowError, MemoryError, pa.ArrowException) as error:
        raise InputError(f"{path}: not a readable Parquet file ({error})") from error
    return RawTable(path, columns, list(range(1, table.num_rows + 1)))


def as_cell(value: object) -> Cell:
    """Integers in text columns (an id, say) keep their digits: only real numbers become float."""
    if value is None or value == "":
        return None
    if isinstance(value, bool | int | float):
        return value
    return value if isinstance(value, str) else str(value)
