"""Logs of robots, and tables of shots, to a dataset by a map of their keys."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from truearc.errors import ELSEWHERE, InputError, needs
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.shot_map import (
    MARKS,
    MOTOR,
    NOT_MARKED,
    WHEEL,
    ShotMap,
    Signal,
    as_signal,
    factor_of,
    own_unit,
    plain,
    unit_in,
)
from truearc.sim.data.dataset import Dataset
from truearc.sim.data.files import assemble
from truearc.sim.data.importers.find_shots import FoundShots, find_shots, silences, spikes
from truearc.sim.data.importers.registry import load_importers
from truearc.sim.data.importers.series import Log, Series, read_csv_log
from truearc.sim.data.recordings import AFTER_S, BEFORE_S
from truearc.sim.data.table import Cell, RawTable, gathered
from truearc.sim.printed import Progress, part_of

SECONDS = {"s": 1.0, "ms": 1e3, "us": 1e6}
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
        dataset = assemble(name, rig, problems, as_table(rows, paths[0]), None, _trace_table(traces, paths[0]))
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
        if own_unit(column) and not found.numeric:
            raise InputError(f"{self.path}: {signal.key}: holds texts; {column} is a number")
        if not found.numeric:
            return found
        read = _in_unit(found, column, signal, self.path)
        return self._finite(read) if _is_speed(column) or column == self.map.shots.wheel else read

    def _finite(self, series: Series) -> Series:
        """A speed without the samples that are not finite, or that no wheel can have; their number is said."""
        values = np.asarray(series.values, dtype=float)
        kept = np.isfinite(values)
        series = self._without(series, kept, "that are not finite")
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
            if marks and (mark is None or mark in NOT_MARKED):
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
            row["outcome"], row["side"] = (word or None for word in MARKS[mark])
        return row

    def _marks(self) -> list[tuple[float, str]]:
        """(time, word) in order."""
        said = self.map.outcome
        marks = list[tuple[float, str]]()
        if said.key:
            series = self.series(said.key)
            words = {plain(key): word for key, word in said.values.items()}
            last: tuple[float, str] | None = None
            unknown = Counter[str]()
            for t_s, value in zip(series.t_s, series.values, strict=True):
                text = plain(value)
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
    return column == MOTOR or WHEEL.fullmatch(column) is not None


def _in_unit(series: Series, column: str, signal: Signal, path: Path) -> Series:
    said = signal.unit or series.unit or unit_in(series.name)
    values = np.asarray(series.values, dtype=float) * signal.times + signal.plus
    factor = factor_of(column, said) if said and own_unit(column) else (1.0, 0.0)
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


def _trace_table(traces: list[tuple[str, float, str, float]], path: Path) -> RawTable | None:
    names = ("shot_id", "t_s", "signal", "value")
    return as_table([dict(zip(names, row, strict=True)) for row in traces], path) if traces else None
