"""Tables read from CSV, Parquet and .xlsx files, and typed columns: names, units, ranges and permitted words.

Each row keeps its origin; all errors are collected, so that one run reports them together. A column such as
`distance_ft`, `hood_rad` or `wheel_main_rpm` is converted to the expected unit and name.
"""

import csv
import difflib
import io
import math
import re
import sys
import tomllib
import zipfile
from codecs import BOM_UTF8
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from truearc.errors import MAX_BYTES, InputError, load_bytes
from truearc.robot.config.rig_spec import MOST
from truearc.robot.config.units import BRACKETS, CONVERTED, ZERO, in_unit, unit_of
from truearc.robot.config.units import WHEEL as WHEEL
from truearc.sim.data.dataset import Floats, Written

DECIMAL_COMMA = re.compile(r"^\s*([+-]?\d+),(\d+)\s*$")
THOUSANDS = re.compile(r"^\s*[+-]?[1-9]\d{0,2},\d{3}\s*$")
DECIMAL_POINT = re.compile(r"^\s*[+-]?\d*\.\d+\s*$")
Cell = str | float | None             # CSV gives text; Parquet numbers, text or None
# Of a Parquet file: a column of one value has any length in a few bytes, one of measured numbers takes bytes for each.
MOST_CELLS, CELLS_PER_BYTE = 2_000_000, 20
XLSX = ".xlsx"
SHOWN = 20                            # problems a message lists before it only counts


class Problems(list[str]):
    """Error messages, each with its place."""

    def add(self, place: str, column: str, what: str) -> None:
        """Add a message. place: file and line; column: name, or '' for the whole row."""
        self.append(f"{place}: {column}: {what}" if column else f"{place}: {what}")

    def close(self) -> None:
        """Raise InputError with the first problems and their number, if there are any."""
        more = len(self) - SHOWN
        tail = [f"... and {more} more problems ({len(self)} in all)"] if more > 0 else []
        if self:
            raise InputError("\n".join(self[:SHOWN] + tail))


@contextmanager
def gathered() -> Iterator[Problems]:
    """Collect problems and raise them together at the end of the block."""
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
    called otherwise in the file.
    """

    path: Path
    columns: dict[str, list[Cell]]
    lines: list[int]
    in_memory: bool = False
    written: dict[str, Written] = field(default_factory=dict)

    def shown(self, name: str, number: float) -> str:
        """Return a number of a column as in the file."""
        _, factor, zero = self.written.get(name, ("", 1.0, 0.0))
        return f"{number / factor + zero:g}"

    def fault(self, problems: Problems, row: int, name: str, what: str) -> None:
        """Add a problem of a cell, or of the header (row -1), with the column's name as in the file."""
        problems.add(self.place(row), self.written.get(name, (name,))[0], what)

    def place(self, row: int) -> str:
        """Return file and line as used in messages; row -1 is the header."""
        if self.in_memory or self.path.suffix == ".parquet":
            return f"{self.path}: row {self.lines[row]}" if row >= 0 else f"{self.path}"
        return f"{self.path}:{self.lines[row] if row >= 0 else 1}"


def find_table(directory: Path, stem: str) -> Path | None:
    """Return the CSV or Parquet file of that name, None if there is neither; InputError if there are both."""
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
    """Parse CSV text with a header; empty cells are None. Blank lines, and empty columns after the last named one, are
    skipped."""
    rows = _rows(text, path, _separator(text, path))
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
    _warn(f"{path}: read with commas as decimal points: {', '.join(read)}")
    return {name: [cell and DECIMAL_COMMA.sub(r"\1.\2", str(cell)) for cell in column] if name in read else column
            for name, column in columns.items()}


@cache
def _warn(message: str) -> None:
    """Print a warning, once: an import reads a table twice."""
    print(f"warning: {message}", file=sys.stderr)


def _separator(text: str, path: Path) -> str:
    """Spreadsheets of many countries write semicolons, and then commas for decimal points; others tabs."""
    header = text.lstrip("\r\n").partition("\n")[0]
    for mark, name in ((";", "semicolons"), ("\t", "tabs")):
        if mark in header and "," not in header:
            _warn(f"{path}: read with {name} between cells")
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
    """Read a text file, or the first sheet of a workbook as CSV; InputError names it and any line that is not UTF-8."""
    if path.suffix.lower() == XLSX:
        return _text_of_sheet(path)
    data = load_bytes(path)
    if data.startswith(BOM_UTF8):
        _warn(f"{path}: read without the byte-order mark that it begins with")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise InputError(f"{path}:{line}: not UTF-8 text; save the table as UTF-8 (in a spreadsheet: CSV UTF-8)"
                         ) from error


def _text_of_sheet(path: Path) -> str:
    """A line for each row: dates as in ISO 8601, of formulas the stored values."""
    try:
        from openpyxl import load_workbook
        from openpyxl.utils.exceptions import InvalidFileException
    except ModuleNotFoundError as error:
        raise InputError(f"{path}: needs openpyxl, which is not installed: pip install 'truearc[xlsx]'") from error
    data = load_bytes(path)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as parts:
            if sum(part.file_size for part in parts.infolist()) > MAX_BYTES:
                raise InputError(f"{path}: unpacks to more than {MAX_BYTES} bytes, the most that is read of a table")
        stored, written = (load_workbook(io.BytesIO(data), data_only=values).worksheets for values in (True, False))
    except (zipfile.BadZipFile, InvalidFileException, KeyError, ValueError, TypeError, OSError) as error:
        raise InputError(f"{path}: is not a workbook that can be read; save it as .xlsx again, or as CSV") from error
    text = io.StringIO()
    filled = False
    for values, cells in zip(stored[0].iter_rows(values_only=True), written[0].iter_rows(), strict=True):
        for value, cell in zip(values, cells, strict=True):
            if value is None and cell.data_type == "f":
                raise InputError(f"{path}:{cell.row}: {cell.coordinate} has a formula without a stored value; open the "
                                 "workbook in a spreadsheet program and save it")
        row = [_sheet_cell(value) for value in values]
        filled |= any(row)
        csv.writer(text).writerow(row)
    if not filled:
        raise InputError(f"{path}: its first sheet, {stored[0].title!r}, is empty; move the table there")
    return text.getvalue()


def _sheet_cell(value: object) -> str:
    plain = str(value).lower() if isinstance(value, bool) else "" if value is None else str(value)
    return " ".join(plain.splitlines()).removesuffix(" 00:00:00")       # of a date


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
    """Convert a cell: integers in text columns (an id, say) keep their digits; only real numbers become float."""
    if value is None or value == "":
        return None
    if isinstance(value, bool | int | float):
        return value
    return value if isinstance(value, str) else str(value)


FEWEST_NAMES = 3                      # of a header
MOST_TITLE = 20                       # lines of a title above the header, less one


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


def any_table(path: Path) -> RawTable:
    """The table below the first line with names enough for a header, else below the first line."""
    found = table_below(path, _is_header) or table_below(path, lambda cells, after: True)
    if found is None:
        raise InputError(f"{path}:1: the header is missing")
    return found


def _is_header(cells: set[str], _: str) -> bool:
    names = {name for name in cells if name and not set(name) & set(",;\t")}
    return len(names) >= FEWEST_NAMES and all(parse_number(name) is None for name in names)


def _header(lines: list[str]) -> set[str]:
    """Cells of the first line, of any separator; a cell in quotes may go on in the next."""
    cells = set(re.split(r"[,;\t]", lines[0].strip("\r\n")))
    for mark in ",;\t":
        with suppress(csv.Error):
            cells.update(next(csv.reader(lines, delimiter=mark), []))
    return {cell.strip().strip('"') for cell in cells}


def holds_numbers(line: str) -> bool:
    """Whether each cell of a line that is not empty is a number."""
    return all(parse_number(cell) is not None for cell in _cells_of(line) if cell)


def _cells_of(line: str) -> list[str]:
    """Cells of a line without quotes around several, numbers with a point."""
    cells = re.split(r"[;\t]" if ";" in line or "\t" in line else ",", line.strip("\r\n"))
    return [cell.strip().strip('"').replace(",", ".") for cell in cells]


OUTCOMES = ("miss", "two", "three")
SPELLINGS = {"2": "two", "3": "three", "2.0": "two", "3.0": "three",
             **dict.fromkeys(("n/a", "na", "-", "nan", "none"), "")}
SIDES = ("low", "high", "left", "right", "short", "long")     # short and long of an opening that faces up

SPIN_VECTOR = ("exit_spin_x_rev_s", "exit_spin_y_rev_s", "exit_spin_z_rev_s")

# (lowest, highest) that a launcher and a field can give; beyond is a slip of the pen or of a unit
RANGES = {
    "distance_m": (0.0, 100.0),
    "hood_deg": (0.0, 90.0),
    "motor_ratio": (0.0, 1.0),
    "miss_height_m": (-100.0, 100.0),
    "exit_speed_m_s": (0.0, 200.0),
    "exit_deg": (-90.0, 90.0),
    "exit_spin_rev_s": (-1000.0, 1000.0),
    **dict.fromkeys(SPIN_VECTOR, (-1000.0, 1000.0)),
    "t_s": (-math.inf, math.inf),
    "since_last_shot_s": (0.0, math.inf),
    "battery_v": (0.0, 1000.0),
    "robot_speed_m_s": (-20.0, 20.0),
    "temperature_c": (-90.0, 60.0),                           # of air anywhere on Earth
    "pressure_pa": (30_000.0, 110_000.0),                     # from the highest mountain to the deepest shore
    "mass_kg": (1e-4, 100.0),
    "radius_m": (0.001, MOST["ball.radius_m"]),
}
HIT = "hit"                           # an outcome, too, where every hit counts alike
SERVO = "hood_position"               # of the hood's servo: an angle by launcher.hood.map of the rig, else a covariate
NO_RANGE = (-math.inf, math.inf)
ALIKE = 3                                                     # fewest bad numbers of a column that are one problem
WORDS = {"outcome": OUTCOMES, "side": SIDES}
VOCABULARY = tomllib.loads(Path(__file__).with_name("words.toml").read_text(encoding="utf-8"))
# what people write of a shot -> the word of a map (robot/config/shot_map.py)
SAID_OF_SHOTS = {text: word for word, texts in VOCABULARY["outcomes"].items() for text in texts}
SYNONYMS: dict[str, str] = {name: column for column, names in VOCABULARY["synonyms"].items() for name in names}
TODO = {"hit": "; if it says that it went in, write hit", "miss": "; if it says that it missed, write miss",
        "miss-low": "; write miss, and low in the column side",
        "miss-high": "; write miss, and high in the column side",
        **{f"miss-{side}": f"; write miss, and {side} in the column side" for side in ("left", "right")},
        "rejected": "; leave the cell empty"}
CORRECTIONS = {**{text: TODO[word] for text, word in SAID_OF_SHOTS.items()},
               **dict.fromkeys(("rim", "bounced", "bounce"), "; write hit if it went in, else miss")}
TEXTS = ("session", "ball_id", "day", "fired_by")

# An undeclared column is one of numbers when its cells are, or when some are and its name ends in a unit (then
# text in it is an error).
UNITS = ("m", "s", "deg", "rad", "rad_s", "rev_s", "m_s", "v", "a", "c", "k", "pa", "kg", "kg_m3", "m_s2", "ratio",
         "rpm", "nm", "hz", "n")
NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*", re.ASCII)
NOT_FINITE = re.compile(r"\s*[+-]?(nan|inf|infinity)\s*", re.ASCII | re.IGNORECASE)
# columns of shots without a range of their own that code reads by name
SALVO = ("fired", "hits")             # balls of a row at one setting, and how many of them scored
OTHERS = ("config_id", "shot_id", SERVO, *SALVO)
# column of shots -> words by which a name means it, unless it or one of these is there
MEANT_BY: dict[str, tuple[set[str], tuple[str, ...]]] = {
    "shot_id": ({"shot", "id"}, ()),
    "distance_m": ({"dist", "distance", "range"}, ()),
    "hood_deg": ({"hood", "angle", "elevation", "pitch"}, ("exit_deg",)),
    "motor_ratio": ({"ratio", "power", "throttle", "duty"}, ("exit_speed_m_s", WHEEL.pattern)),
    "outcome": ({"outcome", "result", "score", "scored"}, ("miss_height_m",)),
}
# names that say the motors' speed otherwise than by motor_ratio, and what to do with their numbers
MOTOR = re.compile(r"(motors?|flywheels?|shooter)_?(rpm|speed|velocity|rad_?s|rev_?s|rps|deg_?s|percent|pct|output)?"
                   r"(_(rpm|rad_s|rev_s|rps|deg_s|percent|pct))?|rpm|percent_output")
MOTOR_HOW = ("is not read; motor_ratio is the motors' speed by their free speed: divide by the free speed in the same "
             "unit, percent of it by 100, and name the column motor_ratio; or state each wheel: wheel_<name>_rpm, "
             "wheel_<name>_rad_s")
WHEELS = re.compile(r"wheels?_(rpm|rad_s|rev_s|speed|rps)")
NEAR = 0.85                           # likeness of a column's name to one that is read, above which it is a slip


def parse_number(cell: Cell) -> float | None:
    """Return the number in a cell, finite or not; None if there is none."""
    if not isinstance(cell, str):
        return None if cell is None else float(cell)
    return float(cell) if NUMBER.fullmatch(cell) or NOT_FINITE.fullmatch(cell) else None


def is_numeric(name: str, cells: list[Cell]) -> bool:
    """Return whether a column of shots is numeric."""
    if name in RANGES or WHEEL.fullmatch(name):
        return True
    if name in WORDS or name in TEXTS or name == "shot_id":
        return False
    filled = [parse_number(cell) is not None for cell in cells if cell is not None]
    if not filled or (any(filled) and not all(filled)):
        return name.endswith(tuple(f"_{unit}" for unit in UNITS))
    return all(filled)


def need_columns(table: RawTable, names: Sequence[str]) -> None:
    """Raise InputError if columns are missing, naming the file and all of them."""
    missing = [name for name in names if name not in table.columns]
    if missing:
        raise InputError(f"{table.place(-1)}: column{'s'[:len(missing) > 1]} {', '.join(missing)} "
                         + ("are" if missing[1:] else "is") + " missing")


def number_column(table: RawTable, name: str, problems: Problems, needed: bool = True) -> Floats:
    """Return a column of finite numbers [n], NaN for an empty cell.

    A problem is any other cell, a number out of range, or an empty cell where one is required.
    """
    low, high = RANGES.get(name, NO_RANGE)
    values = np.full(len(table.lines), np.nan)
    beyond: dict[int, float] = {}
    odd: dict[str, list[int]] = {}
    for row, cell in enumerate(table.columns[name]):
        number = parse_number(cell)
        if cell is None:
            if needed:
                table.fault(problems, row, name, "is missing")
        elif number is None or not math.isfinite(number):
            odd.setdefault("; decimals have a point, thousands no mark" if "," in str(cell) else
                           "; write digits alone, and the unit in the column's name; leave the cell empty where there "
                           "is none", []).append(row)
        elif not low <= number <= high:
            beyond[row] = number
        else:
            values[row] = number
    for todo, rows in odd.items():
        more = f"; here and in {len(rows) - 1} more rows" if len(rows) >= ALIKE else ""
        for row in rows[:1 if more else None]:
            table.fault(problems, row, name, f"{table.columns[name][row]!r} is not a finite number{todo}{more}")
    others = values[np.isfinite(values)]
    most = np.array([*beyond.values(), *(others if len(beyond) <= len(others) else ())])
    looks = _slip_of_all(table, name, most) if beyond else ""
    alike = len(beyond) >= ALIKE and (len(beyond) > len(others) or bool(looks))
    for row, number in list(beyond.items())[:1 if alike else None]:
        table.fault(problems, row, name, _beyond(table, name, number, others, looks)
                    + (f"; here and in {len(beyond) - 1} more rows" if alike else ""))
    return values


def _units(table: RawTable, name: str, values: Floats, least: float, most: float) -> list[str]:
    """The units in which numbers of a column, as in the file, would be within a span."""
    own, (_, factor, zero) = unit_of(name), table.written.get(name, ("", 1.0, 0.0))
    return [unit for unit, size in ({own: 1.0} | CONVERTED.get(own, {})).items() if own and len(values) and (
        (least <= (read := (values / factor + zero - ZERO.get(unit, 0.0)) * size)) & (read <= most)).all()]


def _slip_of_all(table: RawTable, name: str, values: Floats) -> str:
    """What a column's numbers, some of which are out of range, are together: of another column, or unit; "" for none.
    """
    def likely(column: str, value: float) -> bool:
        low, high = VOCABULARY["likely"].get("wheel" if WHEEL.fullmatch(column) else column, (math.inf, 0.0))
        return bool(low <= value <= high)
    middle, (written, factor, zero) = float(np.median(values)), table.written.get(name, (name, 1.0, 0.0))
    units = _units(table, name, values, *VOCABULARY["likely"].get(name, (math.inf, 0.0)))
    for other, cells in table.columns.items():
        numbers = [number for cell in cells if (number := parse_number(cell)) is not None]
        its = float(np.median(numbers or [math.nan]))
        called, size, start = table.written.get(other, (other, 1.0, 0.0))
        if (likely(other, (middle / factor + zero - start) * size) and not likely(name, middle)
                and likely(name, (its / size + start - zero) * factor) and not (units and likely(other, its))):
            return f"{written} and {called} look exchanged: exchange their names"
    names = [in_unit(written, unit) if BRACKETS.search(written) else name.removesuffix(unit_of(name)) + unit
             for unit in units]
    return f"rename the column to {' or '.join(names)}" if names else ""


def _beyond(table: RawTable, name: str, number: float, others: Floats, looks: str) -> str:
    """What to say of a number out of its column's range; others: those that are not; looks: what the column does."""
    low, high = RANGES[name]
    likely = _units(table, name, np.array([number]), others.min(initial=math.inf), others.max(initial=-math.inf))
    suggested = f"the others suggest that it is in {' or '.join(likely)}" if likely else ""
    converted = table.written.get(name, ("", 1.0, 0.0))[1:] != (1.0, 0.0)
    looks = looks or suggested or ("make sure that its unit is as its name says" + ", and of launcher.free_speed_rad_s "
                                   "in rig.toml, which is the most" * (name == "motor_ratio") if converted else
                                   VOCABULARY["looks"].get(name, ""))
    if number < low == 0.0:
        looks = VOCABULARY["below"].get(name, "")
    said, least, most = (table.shown(name, value) for value in (number, low, high))
    return f"{said} is out of range ({least} to {most})" + (f"; {looks}" if looks else "")


def text_column(table: RawTable, name: str, problems: Problems, needed: bool = True) -> tuple[str, ...]:
    """Return a column of texts, "" for an empty cell; a problem is a word that is not permitted, or an empty cell where
    one is required."""
    words = WORDS.get(name)
    values = tuple(map(cell_text, table.columns[name]))
    if name == "outcome":
        values = tuple(SPELLINGS.get(plain := value.strip().lower(), plain) for value in values)
    if name == "side":
        values = tuple(value.strip().lower() for value in values)
    told: set[str] = set()
    for row, value in enumerate(values):
        if needed and not value:
            table.fault(problems, row, name, "is missing")
        elif words and value and value not in words and value not in told:
            told.add(value)
            more = values.count(value) - 1
            table.fault(problems, row, name, f"{value!r} is none of {', '.join(words + (HIT,) * (name == 'outcome'))}"
                        + CORRECTIONS.get(value, "")
                        + (f"; here and in {more} more rows" if more else ""))
    return values


def cell_text(cell: Cell) -> str:
    """Return a cell as text, "" for an empty one."""
    return "" if cell is None else str(cell)


def is_shot_column(name: str) -> bool:
    """Return whether code reads a column of shots by this name."""
    return name in (*RANGES, *WORDS, *TEXTS, *OTHERS) or WHEEL.fullmatch(name) is not None


def in_read_units(table: RawTable, is_read: Callable[[str], bool], problems: Problems) -> RawTable:
    """Return the table with columns renamed and converted; case and blanks in their names do not matter.

    is_read: whether code reads a column of that name; others stay as they are. A problem is a column that duplicates
    one already present, or whose name is close to that of a column that is read and missing.
    """
    columns: dict[str, list[Cell]] = {}
    written = {**table.written}
    for name, cells in table.columns.items():
        read, factor, zero = read_as(name, is_read)
        if read in columns:
            problems.add(table.place(-1), name, f"stands for {read}, which is there already; keep one")
        if read != name:
            written[read] = (name, factor, zero)
        columns[read] = cells if (factor, zero) == (1.0, 0.0) else [
            cell if (number := parse_number(cell)) is None else (number - zero) * factor for cell in cells]
    driven = any(re.fullmatch(one, have) for one in ("motor_ratio", *MEANT_BY["motor_ratio"][1]) for have in columns)
    for name in columns:
        if is_read("motor_ratio") and not driven and MOTOR.fullmatch("_".join(name.lower().split())):
            problems.add(table.place(-1), name, MOTOR_HOW)
            continue
        meant = _meant(name, is_read, set(columns))
        if is_read("motor_ratio") and WHEELS.fullmatch("_".join(name.lower().split())):
            problems.add(table.place(-1), name, "names no wheel of the rig: wheel_<name>_rpm, or wheel_<name>_rad_s, "
                         "with the name of a [[launcher.wheel]] of rig.toml")
        elif meant:
            unit = unit_of(meant)
            others = ", ".join(meant.removesuffix(unit) + suffix for suffix in CONVERTED.get(unit, {}))
            problems.add(table.place(-1), name, f"is not a column that is read; did you mean {meant!r}?"
                         + (f" Of another unit: {others}" if others else ""))
    return replace(table, columns=columns, written=written)


def read_as(name: str, is_read: Callable[[str], bool]) -> tuple[str, float, float]:
    """Return the column that a name stands for, the factor of its numbers, and their zero.

    The name itself, 1 and 0 if it is another column.
    """
    plain = "_".join(name.lower().split())
    if is_read(plain):
        return plain, 1.0, 0.0
    for unit, others in CONVERTED.items():
        for suffix, factor in others.items():
            read = plain.removesuffix(suffix) + unit
            if plain.endswith("_" + suffix) and is_read(read) and unit_of(read) == unit:
                return read, factor, ZERO.get(suffix, 0.0)
    return name, 1.0, 0.0


def _meant(name: str, is_read: Callable[[str], bool], there: set[str]) -> str | None:
    """The column that a name is nearly that of, or that it has a word for, unless that one is there too."""
    if is_read(name):
        return None
    words = set(re.split("[^a-z]+", name.lower()))
    for column, (said, instead) in MEANT_BY.items():
        if words & said and is_read(column) and not any(re.fullmatch(one, have) for one in (column, *instead)
                                                        for have in there):
            return column
    plain = "_".join(name.lower().split())
    if plain in SYNONYMS and is_read("shot_id") and read_as(meant := SYNONYMS[plain], is_read)[0] not in there:
        return meant
    plain = plain.removesuffix(unit_of(plain)).rstrip("_") if plain.startswith("wheel_") else plain
    without_unit = [f"{plain}_{unit}" for unit in CONVERTED if is_read(f"{plain}_{unit}")]
    like = difflib.get_close_matches(plain, [*RANGES, *WORDS, *OTHERS], 1, NEAR)
    return next((one for one in [*without_unit, *like] if is_read(one) and one not in there), None)
