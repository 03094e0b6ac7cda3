"""Shots of robot logs and tables, read with a map of their keys."""

import csv
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from truearc.errors import ELSEWHERE, InputError, needs
from truearc.robot.config import shot_map as maps
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.shot_map import MOTOR, ShotMap, Signal, as_signal
from truearc.sim.data.dataset import Dataset
from truearc.sim.data.files import assemble
from truearc.sim.data.importers import load_importers
from truearc.sim.data.log import FoundShots, Log, Series, find_shots, read_csv_log, silences, spikes
from truearc.sim.data.recordings import AFTER_S, BEFORE_S
from truearc.sim.data.table import Cell, RawTable, gathered, load_table, parse_csv, parse_number, text_of
from truearc.sim.printed import Progress, part_of

SECONDS = {"s": 1.0, "ms": 1e3, "us": 1e6}
TRACE = ("shot_id", "t_s", "signal", "value")
MOST_UNKNOWN = 10                     # texts of a signal of outcomes that are named
PUBLISHED_S = 0.2                     # the same mark again, sooner than this, is one that is said in every loop


def read_log(path: Path, shot_map: ShotMap, progress: Progress = lambda done, note: None) -> Log:
    """A log of a kind that an installed distribution reads, or a CSV export.

    Raises:
        InputError: it cannot be read, or its distribution is not installed.
    """
    read = next((one.read for one in load_importers() if one.read is not None and one.takes([str(path)])), None)
    if read is not None:
        return read(path, lambda done: progress(done, path.name))
    if (kind := path.suffix.lower().removeprefix(".")) in ELSEWHERE:
        raise InputError(f"{path}: {needs(kind)}")
    return read_csv_log(path, shot_map.time.column, SECONDS[shot_map.time.unit])


def shots_from_logs(paths: Sequence[Path], shot_map: ShotMap, rig: Rig, name: str,
                    progress: Progress = lambda done, note: None) -> Dataset:
    """Return the shots of logs, each a session of its file's name; what was left out is said.

    Raises:
        InputError: a key of the map is not in a log, has no such unit, or there is no shot at all.
    """
    names = [path.stem for path in paths]
    if len(set(names)) < len(names):
        raise InputError(f"two logs are called {max(names, key=names.count)}: shot_id would not be unique")
    rows: list[dict[str, Cell]] = []
    traces: list[tuple[str, float, str, float]] = []
    damage: list[str] = []
    left_out: list[str] = []
    for number, path in enumerate(paths):
        log = read_log(path, shot_map, part_of(progress, number / len(paths), 1.0 / len(paths)))
        damage += [f"{path.name}: {line}" for line in log.damage]
        found = Reading(path, log, shot_map, rig)
        more, odd = found.rows()
        rows += more
        left_out += odd
        traces += found.traces(more)
    left_out = damage + left_out      # of whole files first
    if not rows:
        raise InputError(f"{', '.join(map(str, paths))}: no shot was found"
                         + "".join(f"\n{line}" for line in left_out[:5]))
    with gathered() as problems:
        samples = as_table([dict(zip(TRACE, row, strict=True)) for row in traces], paths[0]) if traces else None
        dataset = assemble(name, rig, problems, as_table(rows, paths[0]), None, samples)
    return replace(dataset, left_out=tuple(left_out))


class Reading:
    """One log under a map."""

    def __init__(self, path: Path, log: Log, shot_map: ShotMap, rig: Rig) -> None:
        self.path, self.log, self.map, self.rig = path, log, shot_map, rig
        self.odd: list[str] = []
        self.columns = {column: self._column(column, said) for column, said in shot_map.columns.items()}
        self.scales = {column: as_read(column, rig) for column in self.columns}

    def series(self, key: str) -> Series:
        """A signal by its key, with or without the slash in front, or behind where it is from, as in FROM:/KEY."""
        bare = key.removeprefix("/")
        for name in (key, f"/{key}", bare, *(name for name in self.log if name.partition(":")[2] == f"/{bare}")):
            if name in self.log:
                return self.log[name]
        near = [name for name in self.log if key.rpartition("/")[2].lower() in name.lower()]
        raise InputError(f"{self.path}: there is no signal {key}" + (f"; did you mean {', '.join(near[:3])}?" if near
                                                                    else f"; it has {len(self.log)}"))

    def _column(self, column: str, said: str | Signal) -> Series:
        signal = as_signal(said)
        found = self.series(signal.key)
        if maps.own_unit(column) and not found.numeric:
            raise InputError(f"{self.path}: {signal.key}: holds texts; {column} is a number")
        if not found.numeric:
            return found
        read = _in_unit(found, column, signal, self.path)
        return self._finite(read) if _is_speed(column) or column == self.map.shots.wheel else read

    def _finite(self, series: Series) -> Series:
        """A speed without the samples that are not finite, or that no wheel can have; their number is said."""
        values = np.asarray(series.values, dtype=float)
        series = self._without(series, np.isfinite(values), "that are not finite")
        return self._without(series, ~spikes(np.asarray(series.values, dtype=float)), "far above both neighbours")

    def _without(self, series: Series, kept: np.ndarray, what: str) -> Series:
        if not kept.all():
            line = f"{self.path.name}: {series.name}: samples {what}: {np.count_nonzero(~kept)}"
            self.odd += [line] if line not in self.odd else []
        return replace(series, t_s=series.t_s[kept], values=np.asarray(series.values, dtype=float)[kept])

    def shots(self) -> FoundShots:
        """The shots, whether they have a mark or not."""
        shots = self.map.shots
        wheel = self.columns.get(shots.wheel or next((one for one in self.columns if _is_speed(one)), ""))
        if wheel is None:
            raise InputError(f"{self.path}: shots are dips of a speed: the map's columns name no wheel, nor {MOTOR}")
        # a set point is in the unit of the speed that follows it, unless it says otherwise
        column = next(name for name, series in self.columns.items() if series is wheel)
        wanted = None if shots.set_point is None else self._column(column, shots.set_point)
        feed = None if shots.feed is None else self.series(as_signal(shots.feed).key)
        found = find_shots(wheel, wanted, feed, shots.feed_above, shots.least_dip)
        return replace(found, odd=(*silences(wheel, self.log.values()), *found.odd))

    def rows(self) -> tuple[list[dict[str, Cell]], list[str]]:
        """(a row a shot that has a mark, what was left out)."""
        found = self.shots()
        marks = self._marks()
        rows, odd = list[dict[str, Cell]](), [*self.odd, *(f"{self.path.name}: {line}" for line in found.odd)]
        before = float("nan")
        for number, t_s in enumerate(found.t_s):
            until = found.t_s[number + 1] if number + 1 < len(found.t_s) else np.inf
            mark = next((word for at, word in reversed(marks)
                         if t_s < at <= min(until, t_s + self.map.outcome.within_s)),
                        self.map.outcome.otherwise or None)
            since, before = t_s - before, t_s
            if marks and (mark is None or mark in maps.NOT_MARKED):
                odd.append(f"{self.path.name}: t = {t_s:.2f} s: {'no outcome' if mark is None else 'rejected'}")
                continue
            rows.append(self._row(number, float(t_s), since, mark))
        return rows, odd

    def _row(self, number: int, t_s: float, since_s: float, mark: str | None) -> dict[str, Cell]:
        row: dict[str, Cell] = {"shot_id": f"{self.path.stem}-{number:04d}", "session": self.path.stem, "t_s": t_s}
        if np.isfinite(since_s):
            row["since_last_shot_s"] = since_s
        for column, series in self.columns.items():
            value = series.before(t_s)
            name, scale = self.scales[column]
            known = value is not None and (isinstance(value, str) or np.isfinite(value))
            row[name] = None if not known else value if isinstance(value, str) else float(value or 0.0) * scale
        if mark is not None:
            row["outcome"], row["side"] = (word or None for word in maps.MARKS[mark])
        return row

    def _marks(self) -> list[tuple[float, str]]:
        """(time, word) in order."""
        said = self.map.outcome
        marks = list[tuple[float, str]]()
        if said.key:
            series = self.series(said.key)
            words = {maps.plain(key): word for key, word in said.values.items()}
            last: tuple[float, str] | None = None
            unknown = Counter[str]()
            for t_s, value in zip(series.t_s, series.values, strict=True):
                text = maps.plain(value)
                again = last is not None and last[1] == text and (series.each_row or t_s - last[0] < PUBLISHED_S)
                last = float(t_s), text
                if text in words and not again:
                    marks.append((float(t_s), words[text]))
                elif text and not series.numeric and not again:
                    unknown[text] += 1
            self.odd += [f"{self.path.name}: {said.key}: {text!r} ({times(count)}) is none of outcome.values"
                         for text, count in unknown.most_common(MOST_UNKNOWN)]
            if len(unknown) > MOST_UNKNOWN:
                self.odd.append(f"{self.path.name}: {said.key}: {len(unknown) - MOST_UNKNOWN} more such texts")
        for key, word in said.buttons.items():
            pressed = self.series(key)
            on = np.concatenate([[False], np.asarray(pressed.values, dtype=float) > 0.5])
            marks += [(float(t_s), word) for t_s in pressed.t_s[on[1:] & ~on[:-1]]]
        return sorted(marks)

    def traces(self, rows: list[dict[str, Cell]]) -> Iterator[tuple[str, float, str, float]]:
        """The speeds and the battery around each shot."""
        kept = {column: series for column, series in self.columns.items() if _is_speed(column) or column == "battery_v"}
        for column, series in kept.items():
            values = np.asarray(series.values, dtype=float)
            for signal, factor in self._signals(column):
                for row in rows:
                    first, last = np.searchsorted(series.t_s, [float(row["t_s"] or 0.0) - BEFORE_S,
                                                               float(row["t_s"] or 0.0) + AFTER_S])
                    for k in range(first, last):
                        yield (str(row["shot_id"]), float(series.t_s[k]) - float(row["t_s"] or 0.0), signal,
                               float(values[k]) * factor)

    def _signals(self, column: str) -> list[tuple[str, float]]:
        """(name of a trace, factor): of the motors' speed each wheel's."""
        if column != MOTOR:
            return [(column, 1.0)]
        return [(f"wheel_{wheel.name}_rad_s", wheel.gear) for wheel in self.rig.launcher.wheel]


def as_read(column: str, rig: Rig) -> tuple[str, float]:
    """(the column of a dataset that one of a map becomes, the factor of its numbers); InputError where the rig lacks
    the free speed that motor_ratio needs."""
    if column != MOTOR:
        return column, 1.0
    free = rig.launcher.free_speed_rad_s
    if free is None:
        raise InputError(f"{MOTOR}: the rig needs launcher.free_speed_rad_s to make motor_ratio of it")
    return "motor_ratio", 1.0 / free


def _is_speed(column: str) -> bool:
    return column == MOTOR or maps.WHEEL.fullmatch(column) is not None


def _in_unit(series: Series, column: str, signal: Signal, path: Path) -> Series:
    said = signal.unit or series.unit or maps.unit_in(series.name)
    values = np.asarray(series.values, dtype=float) * signal.times + signal.plus
    factor = maps.factor_of(column, said) if said and maps.own_unit(column) else (1.0, 0.0)
    if factor is None:
        raise InputError(f"{path}: {signal.key}: {said!r} is not a unit of {column}; state unit = \"...\" in the map")
    return replace(series, values=(values - factor[1]) * factor[0])


def times(count: int) -> str:
    """A count as a text: once, 2 times."""
    return "once" if count == 1 else f"{count} times"


def as_table(rows: Sequence[Mapping[str, Cell]], path: Path) -> RawTable:
    """Rows as a table; path: for messages."""
    names = dict.fromkeys(name for row in rows for name in row)
    return RawTable(path, {name: [row.get(name) for row in rows] for name in names}, list(range(1, len(rows) + 1)),
                    in_memory=True)


PLACE = re.compile(r"#(\d+)")         # a column by its number
FEWEST_NAMES = 3                      # of a header
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
    texts = [row for row, cell in enumerate(cells) if maps.own_unit(column) and cell is not None and str(cell).strip()
             and parse_number(cell) is None]
    with gathered() as problems:
        problems += [f"{table.place(row)}: {signal.key}: {cells[row]!r} is not a number" for row in texts]
    if not maps.own_unit(column) and (signal.times, signal.plus) == (1.0, 0.0):
        return cells
    stated = signal.unit or maps.unit_in(signal.key)
    factor = maps.factor_of(column, stated) if stated and maps.own_unit(column) else (1.0, 0.0)
    if factor is None:
        raise InputError(f"{table.place(-1)}: {signal.key}: {stated!r} is not a unit of {column}; state unit = \"...\" "
                         "in the map")
    numbers = [parse_number(cell) for cell in cells]
    return [cell if number is None else (number * signal.times + signal.plus - factor[1]) * factor[0]
            for cell, number in zip(cells, numbers, strict=True)]


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
    words = {maps.plain(key): word for key, word in shot_map.outcome.values.items()}
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
            if word in maps.NOT_MARKED:
                odd.append(f"{table.place(row)}: {'rejected' if said else 'no outcome'}")
                continue
            outcome, side = maps.MARKS[word]
            shot["outcome"], shot["side"] = outcome or None, side or shot.get("side")
        rows.append(shot)
        lines.append(table.lines[row])
    return rows, lines, odd


def outcome_text(cell: Cell) -> str:
    """A cell of outcomes as maps compare it; "" for an empty one."""
    number = parse_number(cell)
    return "" if cell is None else maps.plain(cell if number is None else number)


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
