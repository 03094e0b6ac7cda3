"""Shots from robot logs and tables, which are read with a map of their keys."""

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from truearc.errors import ELSEWHERE, InputError, needs
from truearc.robot.config import shot_map as maps
from truearc.robot.config import units
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.shot_map import ShotMap, Signal, as_signal
from truearc.robot.config.units import MOTOR
from truearc.sim.data.dataset import Dataset, Floats, Written
from truearc.sim.data.files import assemble
from truearc.sim.data.importers import load_importers
from truearc.sim.data.log import FoundShots, Log, Series, find_shots, read_csv_log, silences, spikes
from truearc.sim.data.recordings import AFTER_S, BEFORE_S
from truearc.sim.data.table import VOCABULARY, Cell, RawTable, gathered, holds_numbers, parse_number, table_below
from truearc.sim.printed import Progress, part_of

SECONDS = {"s": 1.0, "ms": 1e3, "us": 1e6}
SPEED = re.compile(f"{MOTOR}|{units.WHEEL.pattern}")
PLACE = re.compile(r"#(\d+)")         # a column by its number
NO_TARGET = "distance_m", -1.0        # what programs write of a goal that the camera does not see
Rows = list[dict[str, Cell]]
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
    rows, traces, damage, left_out = Rows(), Rows(), list[str](), list[str]()
    for number, path in enumerate(paths):
        log = read_log(path, shot_map, part_of(progress, number / len(paths), 1.0 / len(paths)))
        damage += [f"{path.name}: {line}" for line in log.damage]
        found = Reading(path, log, shot_map, rig)
        more = found.rows()
        rows += more
        left_out += found.odd
        traces += found.traces(more)
    samples = as_table(traces, paths[0]) if traces else None
    return _assembled(name, rig, as_table(rows, paths[0]), damage + left_out, samples)      # of whole files first


def _assembled(name: str, rig: Rig, shots: RawTable, left_out: list[str], samples: RawTable | None = None) -> Dataset:
    """The dataset of shots and traces; InputError where there is no shot."""
    if not shots.lines:
        raise InputError(f"{shots.path}: no shot was found" + "".join(f"\n{line}" for line in left_out[:5]))
    with gathered() as problems:
        return replace(assemble(name, rig, problems, shots, None, samples), left_out=tuple(left_out))


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
        raise InputError("\n".join((f"{self.path}: there is no signal {key}" + (
            f"; did you mean {', '.join(near[:3])}?" if near else f"; it has {len(self.log)}"), *self.log.damage)))

    def _column(self, column: str, said: str | Signal) -> Series:
        signal = as_signal(said)
        found = self.series(signal.key)
        if not found.numeric:
            if units.own_unit(column):
                raise InputError(f"{self.path}: {signal.key}: holds texts; {column} is a number")
            return found
        convert = conversion(column, signal, signal.unit or found.unit, str(self.path))
        t_s, values = found.t_s, convert(np.asarray(found.values, dtype=float))
        speed = SPEED.fullmatch(column) or column == self.map.shots.wheel        # no wheel can have the other samples
        for what in ("that are not finite", "far above both neighbours") if speed else ():
            kept = np.isfinite(values) if what == "that are not finite" else ~spikes(values)
            line = f"{self.path.name}: {found.name}: samples {what}: {np.count_nonzero(~kept)}"
            self.odd += [line] if not kept.all() and line not in self.odd else []
            t_s, values = t_s[kept], values[kept]
        return replace(found, t_s=t_s, values=values)

    def shots(self) -> FoundShots:
        """The shots, whether they have a mark or not."""
        shots = self.map.shots
        column = shots.wheel or next(filter(SPEED.fullmatch, self.columns), "")
        if column not in self.columns:
            raise InputError(f"{self.path}: shots are dips of a speed: the map's columns name no wheel, nor {MOTOR}")
        # a set point is in the unit of the speed that follows it, unless it says otherwise
        wheel = self.columns[column]
        wanted = None if shots.set_point is None else self._column(column, shots.set_point)
        feed = None if shots.feed is None else self.series(as_signal(shots.feed).key)
        found = find_shots(wheel, wanted, feed, shots.feed_above, shots.least_dip)
        return replace(found, odd=(*silences(wheel, self.log.values()), *found.odd))

    def rows(self) -> Rows:
        """A row a shot that has a mark; what was left out is in `odd`."""
        found, said, file, rows = self.shots(), self.map.outcome, self.path.name, Rows()
        marks = self._marks()
        self.odd += [f"{file}: {line}" for line in found.odd]
        sinces, untils = np.diff(found.t_s, prepend=np.nan), [*found.t_s[1:], np.inf]
        for number, (t_s, since, until) in enumerate(zip(found.t_s.tolist(), sinces.tolist(), untils, strict=False)):
            mark = next((word for at, word in reversed(marks) if t_s < at <= min(until, t_s + said.within_s)),
                        said.otherwise or None)
            if marks and (mark is None or mark in maps.NOT_MARKED):
                self.odd.append(f"{file}: t = {t_s:.2f} s: {'no outcome' if mark is None else 'rejected'}")
                continue
            row: dict[str, Cell] = {"shot_id": f"{self.path.stem}-{number:04d}", "session": self.path.stem, "t_s": t_s}
            row |= {"since_last_shot_s": since} if number else {}
            for column, series in self.columns.items():
                value, (name, scale) = series.before(t_s), self.names[column]
                row[name] = value if value is None or isinstance(value, str) else (
                    float(value) * scale if np.isfinite(value) else None)
            rows.append(row if mark is None else row | ended(mark, self.map, self.rig, f"{file}: t = {t_s:.2f} s"))
        return rows

    def _marks(self) -> list[tuple[float, str]]:
        """(time, word) in order."""
        said, file = self.map.outcome, f"{self.path.name}: {self.map.outcome.key}"
        marks, unknown, last = list[tuple[float, str]](), Counter[str](), (-np.inf, "")
        words = {maps.plain(key): word for key, word in said.values.items()}
        series = self.series(said.key) if said.key else Series("", np.zeros(0), ())
        for t_s, value in zip(series.t_s.tolist(), series.values, strict=True):
            text = maps.plain(value)
            again = last[1] == text and (series.each_row or t_s - last[0] < PUBLISHED_S)
            last = t_s, text
            if text in words and not again:
                marks.append((t_s, words[text]))
            elif text not in VOCABULARY["groups"]["idle"] and not series.numeric and not again:
                unknown[text] += 1
        self.odd += [f"{file}: {text!r} ({times(count)}) is none of outcome.values"
                     for text, count in unknown.most_common(MOST_UNKNOWN)]
        if len(unknown) > MOST_UNKNOWN:
            self.odd.append(f"{file}: {len(unknown) - MOST_UNKNOWN} more such texts")
        for key, word in said.buttons.items():
            pressed = self.series(key)
            on = np.asarray(pressed.values, dtype=float) > 0.5
            marks += [(float(t_s), word) for t_s in pressed.t_s[on & np.diff(on, prepend=False)]]
        return sorted(marks)

    def traces(self, rows: Rows) -> Iterator[dict[str, Cell]]:
        """The speeds and the battery around each shot."""
        for column in filter(re.compile(f"battery_v|{SPEED.pattern}").fullmatch, self.columns):
            series = self.columns[column]
            signals = {column: 1.0} if column != MOTOR else {           # not the motors'
                f"wheel_{wheel.name}_rad_s": wheel.gear for wheel in self.rig.launcher.wheel}
            for signal, factor in signals.items():
                for row in rows:
                    at_s = float(row["t_s"] or 0.0)
                    for k in range(*np.searchsorted(series.t_s, [at_s - BEFORE_S, at_s + AFTER_S])):
                        yield {"shot_id": row["shot_id"], "t_s": float(series.t_s[k]) - at_s, "signal": signal,
                               "value": float(series.values[k]) * factor}


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


def conversion(column: str, signal: Signal, stated: str, place: str) -> Callable[[Floats], Floats]:
    """How numbers of a signal become those of a column; stated: the unit, "" for the one that the key ends in.

    Raises:
        InputError: names the place and the key of a unit that the column does not have.
    """
    unit = stated or units.unit_in(signal.key)
    factor = units.factor_of(column, unit) if unit and units.own_unit(column) else (1.0, 0.0)
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


def shots_from_tables(paths: Sequence[Path], shot_map: ShotMap, rig: Rig, name: str) -> Dataset:
    """Return the shots of tables under a map whose rows are shots, or positions of one ball a file.

    Raises:
        InputError: names file, line and column of what cannot be read, or a column of the map that is not there.
    """
    _check_names(paths)
    tables = [(path, _read(path, shot_map)) for path in paths]
    if shot_map.rows == "position":
        return _tracks(tables, shot_map, rig, name)
    rows, lines, left_out, written = Rows(), list[int](), list[str](), dict[str, Written]()
    for path, table in tables:
        columns, its = _columns(table, shot_map, rig)
        written = its | written                        # as in the first table
        for line, row in _shots(path, table, columns, shot_map, rig, left_out):
            lines.append(line)
            rows.append(row)
    shots = replace(as_table(rows, paths[0]), written=written)
    return _assembled(name, rig, shots if paths[1:] else replace(shots, lines=lines, in_memory=False), left_out)


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


def _columns(table: RawTable, shot_map: ShotMap, rig: Rig) -> tuple[dict[str, list[Cell]], dict[str, Written]]:
    """Cells by the columns of a dataset, numbers in their units; headings, units and zeros in the table."""
    columns, written = dict[str, list[Cell]](), dict[str, Written]()
    for column, said in shot_map.columns.items():
        signal, (name, scale), is_number = as_signal(said), as_read(column, rig), bool(units.own_unit(column))
        key = _key(table, signal)
        columns[name] = cells = table.columns[key]
        with gathered() as problems:
            problems += [f"{table.place(row)}: {signal.key}: {cell!r} is not a number" for row, cell in enumerate(cells)
                         if is_number and str(cell or "").strip() and parse_number(cell) is None]
        if not is_number and (signal.times, signal.plus) == (1.0, 0.0):
            continue
        convert = conversion(column, signal, signal.unit, table.place(-1))
        columns[name] = [
            cell if (number := parse_number(cell)) is None else
            None if (column, number) == NO_TARGET else float(convert(np.asarray(number))) * scale for cell in cells]
        if is_number:
            zero, one = map(float, convert(np.array([0.0, 1.0])))
            written[name] = key, (one - zero) * scale, -zero / (one - zero)
    return columns, written


def _shots(path: Path, table: RawTable, columns: dict[str, list[Cell]], shot_map: ShotMap, rig: Rig, odd: list[str]
           ) -> Iterator[tuple[int, dict[str, Cell]]]:
    """Yield (line, row) of each shot; what is left out is added to `odd`."""
    outcome = shot_map.outcome
    marks = table.columns[_key(table, Signal(outcome.key))] if outcome.key else None
    words = {maps.plain(key): word for key, word in outcome.values.items()}
    distance = as_signal(shot_map.columns.get(NO_TARGET[0], "")).key
    if unseen := [parse_number(cell) for cell in table.columns.get(distance, ())].count(NO_TARGET[1]):
        odd.append(f"{path.name}: {distance}: -1 ({times(unseen)}) is read as an unknown distance")
    for row, line in enumerate(table.lines):
        shot: dict[str, Cell] = {"shot_id": f"{path.stem}-{row:04d}", "session": path.stem,
                                 **{column: cells[row] for column, cells in columns.items()}}
        if marks is not None:
            said = outcome_text(marks[row])
            word = words.get(said, outcome.otherwise)
            if not word and said not in words:
                raise InputError(f"{table.place(row)}: {outcome.key}: {marks[row]!r} is none of the map's values "
                                 f"({', '.join(filter(None, outcome.values))})")
            if word in maps.NOT_MARKED:
                odd.append(f"{table.place(row)}: {'rejected' if said else 'no outcome'}")
                continue
            end = ended(word, shot_map, rig, table.place(row))
            shot |= end | {"side": end["side"] or shot.get("side")}
        yield line, shot


def outcome_text(cell: Cell) -> str:
    """A cell of outcomes as maps compare it; "" for an empty one."""
    return "" if cell is None else maps.plain(cell if (number := parse_number(cell)) is None else number)


def _tracks(tables: list[tuple[Path, RawTable]], shot_map: ShotMap, rig: Rig, name: str) -> Dataset:
    """One shot a file; y_m = 0 where the map names none: filmed from the side."""
    if missing := [one for one in ("t_s", "x_m", "z_m") if one not in shot_map.columns]:
        raise InputError(f"the map has no columns.{missing[0]}: a row is a position, and that needs it")
    rows = Rows()
    for path, table in tables:
        columns, _ = _columns(table, shot_map, rig)
        shots = ({column: cells[row] for column, cells in columns.items()} for row in range(len(table.lines)))
        rows += [{"shot_id": path.stem, "y_m": 0.0, **shot} for shot in shots if None not in shot.values()]
    with gathered() as problems:
        return assemble(name, rig, problems, as_table([{"shot_id": path.stem} for path, _ in tables], tables[0][0]),
                        as_table(rows, tables[0][0]))
