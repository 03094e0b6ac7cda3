"""Shots from robot logs and tables, which are read with a map of their keys."""

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from truearc.errors import ELSEWHERE, InputError, needs
from truearc.robot.config import shot_map as maps
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.shot_map import MOTOR, ShotMap, Signal, as_signal
from truearc.sim.data.dataset import Dataset, Floats, Written
from truearc.sim.data.files import assemble
from truearc.sim.data.importers import load_importers
from truearc.sim.data.log import FoundShots, Log, Series, find_shots, read_csv_log, silences, spikes
from truearc.sim.data.recordings import AFTER_S, BEFORE_S
from truearc.sim.data.table import Cell, RawTable, gathered, holds_numbers, parse_number, table_below
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
    _check_names(paths)
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
    samples = as_table([dict(zip(TRACE, row, strict=True)) for row in traces], paths[0]) if traces else None
    return _assembled(name, rig, as_table(rows, paths[0]), samples, damage + left_out)      # of whole files first


def _assembled(name: str, rig: Rig, shots: RawTable, samples: RawTable | None, left_out: list[str]) -> Dataset:
    """The dataset of shots and traces; InputError where there is no shot."""
    if not shots.lines:
        raise InputError(f"{shots.path}: no shot was found" + "".join(f"\n{line}" for line in left_out[:5]))
    with gathered() as problems:
        dataset = assemble(name, rig, problems, shots, None, samples)
    return replace(dataset, left_out=tuple(left_out))


def _check_names(paths: Sequence[Path]) -> None:
    stems = [path.stem for path in paths]
    if len(set(stems)) < len(stems):
        raise InputError(f"two files are called {max(stems, key=stems.count)}: shot_id would not be unique")


class Reading:
    """One log under a map."""

    def __init__(self, path: Path, log: Log, shot_map: ShotMap, rig: Rig) -> None:
        self.path, self.log, self.map, self.rig = path, log, shot_map, rig
        self.odd: list[str] = []
        self.columns = {column: self._column(column, said) for column, said in shot_map.columns.items()}
        self.names = {column: as_read(column, rig) for column in self.columns}

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
        convert = conversion(column, signal, signal.unit or found.unit, str(self.path))
        read = replace(found, values=convert(np.asarray(found.values, dtype=float)))
        if _is_speed(column) or column == self.map.shots.wheel:        # no wheel can have the other samples
            read = self._without(read, np.isfinite(read.values), "that are not finite")
            read = self._without(read, ~spikes(np.asarray(read.values, dtype=float)), "far above both neighbours")
        return read

    def _without(self, series: Series, kept: np.ndarray, what: str) -> Series:
        """A series without some samples, whose number is reported."""
        line = f"{self.path.name}: {series.name}: samples {what}: {np.count_nonzero(~kept)}"
        self.odd += [line] if not kept.all() and line not in self.odd else []
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
            name, scale = self.names[column]
            known = value is not None and (isinstance(value, str) or np.isfinite(value))
            row[name] = None if not known else value if isinstance(value, str) else float(value or 0.0) * scale
        return row if mark is None else row | ended(mark, self.map, self.rig, f"{self.path.name}: t = {t_s:.2f} s")

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
            signals = [(column, 1.0)] if column != MOTOR else [
                (f"wheel_{wheel.name}_rad_s", wheel.gear) for wheel in self.rig.launcher.wheel]       # not the motors'
            for signal, factor in signals:
                for row in rows:
                    at_s = float(row["t_s"] or 0.0)
                    for k in range(*np.searchsorted(series.t_s, [at_s - BEFORE_S, at_s + AFTER_S])):
                        yield str(row["shot_id"]), float(series.t_s[k]) - at_s, signal, float(values[k]) * factor


def ended(mark: str, shot_map: ShotMap, rig: Rig, place: str) -> dict[str, Cell]:
    """Outcome and side of a shot by the word of its mark; InputError where that is a hit, and may be a two or a three.
    """
    outcome, side = maps.MARKS[mark]
    if outcome == "hit" and rig.target is not None and not rig.target.hit_or_miss:
        said = [text for text, word in (shot_map.outcome.values | shot_map.outcome.buttons).items() if word == mark]
        raise InputError(f"{place}: outcome: {' or '.join(map(repr, said)) or 'otherwise'} is a hit by the map, which "
                         "may be a two or a three: write which in outcome.values; where every hit counts alike, state "
                         "target.three_half_height_m = 0 in rig.toml")
    outcome, side = (outcome, side) if rig.target is None else rig.target.noted(outcome, side)
    return {"outcome": outcome or None, "side": side or None}


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


def conversion(column: str, signal: Signal, stated: str, place: str) -> Callable[[Floats], Floats]:
    """How numbers of a signal become those of a column; stated: the unit, "" for the one that the key ends in.

    Raises:
        InputError: names the place and the key of a unit that the column does not have.
    """
    unit = stated or maps.unit_in(signal.key)
    factor = maps.factor_of(column, unit) if unit and maps.own_unit(column) else (1.0, 0.0)
    if factor is None:
        raise InputError(f"{place}: {signal.key}: {unit!r} is not a unit of {column}; state unit = \"...\" in the map")
    return lambda values: (values * signal.times + signal.plus - factor[1]) * factor[0]


def times(count: int) -> str:
    """A count as a text: once, 2 times."""
    return "once" if count == 1 else f"{count} times"


def as_table(rows: Sequence[Mapping[str, Cell]], path: Path) -> RawTable:
    """Rows as a table; path: for messages."""
    names = dict.fromkeys(name for row in rows for name in row)
    return RawTable(path, {name: [row.get(name) for row in rows] for name in names}, list(range(1, len(rows) + 1)),
                    in_memory=True)


NO_TARGET = "distance_m", -1.0          # what programs write of a goal that the camera does not see
PLACE = re.compile(r"#(\d+)")         # a column by its number


def shots_from_tables(paths: Sequence[Path], shot_map: ShotMap, rig: Rig, name: str) -> Dataset:
    """Return the shots of tables under a map whose rows are shots, or positions of one ball a file.

    Raises:
        InputError: names file, line and column of what cannot be read, or a column of the map that is not there.
    """
    _check_names(paths)
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
    shots = replace(as_table(rows, paths[0]), written=_written(tables[0][1], shot_map, rig))
    return _assembled(name, rig, shots if paths[1:] else replace(shots, lines=lines, in_memory=False), None, left_out)


def _written(table: RawTable, shot_map: ShotMap, rig: Rig) -> dict[str, Written]:
    """What the columns of a dataset are in a table: headings, units and zeros."""
    found: dict[str, Written] = {}
    for column, said in shot_map.columns.items():
        signal, (name, scale) = as_signal(said), as_read(column, rig)
        if maps.own_unit(column):
            convert = conversion(column, signal, signal.unit, table.place(-1))
            zero, one = map(float, convert(np.array([0.0, 1.0])))
            found[name] = _key(table, signal), (one - zero) * scale, -zero / (one - zero)
    return found


def _read(path: Path, shot_map: ShotMap) -> RawTable:
    """The table below the line that has the map's columns; what stands before it is a title of the program's."""
    wanted = {as_signal(said).key for said in shot_map.columns.values()} | ({shot_map.outcome.key} - {""})
    names = {key for key in wanted if not PLACE.fullmatch(key)}
    found = table_below(path, lambda cells, after: names <= cells and (bool(names) or holds_numbers(after)))
    if found is None or not names <= set(found.columns):
        raise InputError(f"{path}:1: there is no line with the columns {', '.join(sorted(names))}")
    return found


def _key(table: RawTable, signal: Signal) -> str:
    """The name of a signal's column, which a map may call by its place."""
    place = PLACE.fullmatch(signal.key)
    names = list(table.columns)
    if place and not 1 <= int(place[1]) <= len(names):
        raise InputError(f"{table.place(-1)}: there is no column {signal.key}; it has {len(names)}")
    return names[int(place[1]) - 1] if place else signal.key


def _column(table: RawTable, column: str, said: str | Signal, scale: float = 1.0) -> list[Cell]:
    """Cells of a column, numbers in its unit times a factor."""
    signal = as_signal(said)
    cells = table.columns[_key(table, signal)]
    with gathered() as problems:
        problems += [f"{table.place(row)}: {signal.key}: {cell!r} is not a number" for row, cell in enumerate(cells)
                     if maps.own_unit(column) and str(cell or "").strip() and parse_number(cell) is None]
    if not maps.own_unit(column) and (signal.times, signal.plus) == (1.0, 0.0):
        return cells
    convert = conversion(column, signal, signal.unit, table.place(-1))
    return [cell if (number := parse_number(cell)) is None else
            None if (column, number) == NO_TARGET else float(convert(np.asarray(number))) * scale for cell in cells]


def _shots(path: Path, table: RawTable, shot_map: ShotMap, rig: Rig
           ) -> tuple[list[dict[str, Cell]], list[int], list[str]]:
    """(a row a shot, the line of each, what was left out)."""
    named = {column: as_read(column, rig) for column in shot_map.columns}
    columns = {named[column][0]: _column(table, column, said, named[column][1])
               for column, said in shot_map.columns.items()}
    marks = table.columns[_key(table, Signal(shot_map.outcome.key))] if shot_map.outcome.key else None
    words = {maps.plain(key): word for key, word in shot_map.outcome.values.items()}
    rows, lines, odd = list[dict[str, Cell]](), list[int](), list[str]()
    distance = as_signal(shot_map.columns.get(NO_TARGET[0], "")).key
    if unseen := [parse_number(cell) for cell in table.columns.get(distance, ())].count(NO_TARGET[1]):
        odd.append(f"{path.name}: {distance}: -1 ({times(unseen)}) is read as an unknown distance")
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
            side = shot.get("side")
            shot |= ended(word, shot_map, rig, table.place(row))
            shot["side"] = shot["side"] or side
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
