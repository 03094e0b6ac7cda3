"""A map proposed from the columns of tables with a row per shot."""

import csv
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from itertools import islice, zip_longest
from pathlib import Path

import numpy as np

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.shot_map import (
    MOTOR,
    NOT_MARKED,
    SCHEMA,
    UNITS,
    WHEEL,
    OutcomeKeys,
    ShotMap,
    Signal,
    own_unit,
    unit_in,
    unit_of,
)
from truearc.sim.data.columns import SIDES, is_shot_column, parse_number, read_as
from truearc.sim.data.importers.guess_map import NO_OUTCOME, Guess
from truearc.sim.data.importers.mapped_tables import PLACE, outcome_text, table_below
from truearc.sim.data.importers.recognise import (
    ANGLE,
    GEARED,
    MOST_WORDS,
    OUTCOME,
    SPEED,
    SPIN,
    WANTED,
    best,
    meanings,
    not_recognised,
    outcome_lines,
    unit_note,
    unit_said,
    wheel_column,
    words_of,
)
from truearc.sim.data.importers.series import TIME, Series
from truearc.sim.data.table import Cell, RawTable, gathered, load_table

# column of shots -> (words that name it, words beside one that do not say what it is of, words of something else)
NAMED = {
    "distance_m": ({"distance", "dist", "range"}, set[str](), WANTED - {"target", "goal"}),
    "hood_deg": ({"hood", "pivot", "elevation", "pitch", "angle"}, ANGLE,
                 WANTED | {"turret", "robot", "heading", "yaw", "azimuth", "gyro", "exit", "entry"}),
    MOTOR: (SPIN | {"speed", "velocity", "rpm"}, SPEED,
            WANTED | {"exit", "ball", "robot", "wind", "drive", "feeder", "intake", "spin", "backspin"}),
    "battery_v": ({"battery", "voltage", "volts", "bus"}, set[str](), WANTED | {"motor", "sensor"}),
    "temperature_c": ({"temp", "temperature"}, set[str](), {"motor", "wheel", "flywheel", "battery", "ball"}),
    "t_s": ({"time", "clock"}, set[str](), {"flight", "air", "hang", "spinup", "up", "recovery"}),
}
NEEDED = ("distance_m", "hood_deg", MOTOR)
# the other columns that stand for one of those
INSTEAD = {"hood_deg": ("exit_deg",), MOTOR: ("motor_ratio", "exit_speed_m_s")}
TEXTS = {"ball_id": {"ball"}, "session": {"session", "day", "date", "practice"}}
NUMBERED = {"shot", "order", "number", "no", "nr", "index", "trial", "attempt", "id", "name"}
VERTICAL = {"vertical", "zenith", "plumb"}             # from which an angle is counted
YES_NO = {"0", "1", "yes", "no", "y", "n"}
POINTS = ({"0", "1"}, {"0", "2", "3"})                 # outcomes as numbers
HEAD_BYTES = 65_536                                    # in which a header ends
LEAST_V = 5.0                                          # of a battery; less is its number
LEAST_STEP_S, LEAST_ROWS = 0.5, 20                     # rows of a log are closer, and at least that many


def is_log(path: Path) -> bool:
    """Whether a file is no table, or has a log's column of times; also where it cannot be opened, as the log's reader
    says why."""
    if path.suffix.lower() not in (".csv", ".txt", ".parquet"):
        return True
    if path.suffix == ".parquet":
        with gathered() as problems:
            return TIME in load_table(path, problems).columns
    try:
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES).decode("utf-8-sig", errors="replace").splitlines()
    except OSError:
        return True
    for mark in ",;\t":
        with suppress(csv.Error):
            header, first = (*islice(csv.reader(head, delimiter=mark), 2), [], [])[:2]
            cells = dict(zip_longest(map(str.strip, header), first, fillvalue="0"))
            if TIME in cells:
                return parse_number(cells[TIME].replace(",", ".")) is not None
    return False


def guess_table(paths: Sequence[Path], rig: Rig) -> Guess:
    """Propose a map for tables whose rows are shots, by the columns of the first.

    Raises:
        InputError: no column looks like a distance, an angle or a speed; it lists what was recognised and the columns.
    """
    return _Guessing([_table(path) for path in paths], rig, str(paths[0])).guess()


def _table(path: Path) -> RawTable:
    found = table_below(path, _is_header) or table_below(path, lambda cells, after: True)
    if found is None:
        raise InputError(f"{path}:1: the header is missing")
    return found


def _is_header(cells: set[str], _: str) -> bool:
    names = {name for name in cells if name and not set(name) & set(",;\t")}
    return len(names) >= len(NEEDED) and all(parse_number(name) is None for name in names)


def _series(name: str, cells: list[Cell]) -> Series | None:
    """Numbers where most cells are: the others are named as the table is read."""
    rows = [row for row, cell in enumerate(cells) if cell is not None and str(cell).strip()]
    if not rows:
        return None
    numbers = [parse_number(cells[row]) for row in rows]
    last = words_of(name)[-1:]
    unit = unit_in(name) or (UNITS.get(last[0], "") if last else "")
    times = np.array(rows, dtype=float)
    if 2 * numbers.count(None) >= len(numbers):
        return Series(name, times, tuple(str(cells[row]).strip() for row in rows), unit, each_row=True)
    return Series(name, times, np.array([np.nan if number is None else number for number in numbers]), unit,
                  each_row=True)


class _Guessing:
    """A map in the making: columns of shots are taken one by one, and no column of the table twice."""

    def __init__(self, tables: Sequence[RawTable], rig: Rig, name: str) -> None:
        self.tables, self.rig, self.name = tables, rig, name
        self.columns: dict[str, Signal] = {}
        self.all = {key: series for key, cells in tables[0].columns.items()
                    if (series := _series(key, cells)) is not None}
        self.free = {**self.all}                       # that are not taken yet
        self.lines: list[str] = []

    def guess(self) -> Guess:
        """Names that shots.csv has come first, then what is needed, outcomes, and what is of use."""
        outcome, said = self._outcome()
        for key in list(self.free):
            self._take_own(key)
        missing = [column for column in NEEDED if not self._take_needed(column)]
        if missing:
            moving = {key: series for key, series in self.all.items() if series.numeric}
            raise not_recognised(self.name, [wheel_column(self.rig) if column == MOTOR else column
                                             for column in missing], self.lines, moving, "column",
                                 f" (a log has its times in a column {TIME})")
        for column in ("battery_v", "temperature_c", "t_s"):
            self._take_number(column, column)
        self._refuse_log()
        for column, nouns in TEXTS.items():
            self._take_text(column, nouns)
        self._take_order()
        self.lines += said
        if self.free:
            self.lines.append(f"not used: {', '.join(self.free)}")
        shot_map = ShotMap(SCHEMA, rows="shot", columns={**self.columns}, outcome=outcome)
        return Guess(shot_map, tuple(self.lines))

    def _take(self, column: str, key: str, unit: str = "", note: str = "") -> None:
        self.columns[column] = Signal(self._key(key), unit=unit)
        self.lines.append(f"{column}: {key}{note}")
        self.free.pop(key, None)

    def _key(self, key: str) -> str:
        """A column as a map names it: one that is called #2 by its place."""
        return f"#{list(self.tables[0].columns).index(key) + 1}" if PLACE.fullmatch(key) else key

    def _take_own(self, key: str) -> None:
        """A column that is called as one of shots.csv."""
        column, *_ = read_as(key, is_shot_column)
        series = self.free[key]
        if not is_shot_column(column) or column in self.columns or column == "outcome":
            return
        if column == "side" and {str(value).lower() for value in series.values} - {*SIDES}:
            return
        if column == "shot_id" and not self._is_name(key):
            return
        own = own_unit(column)
        plain = "_".join(key.lower().split())
        suffix = plain[len(column) - len(unit_of(column)):] if own else ""
        self._take(column, key, suffix, f", in {suffix}" if suffix else "")

    def _take_needed(self, column: str) -> bool:
        instead = INSTEAD.get(column, ())
        if column in self.columns or any(one in self.columns for one in instead):
            return True
        if column == MOTOR and any(WHEEL.fullmatch(one) for one in self.columns):
            return True
        read = wheel_column(self.rig) if column == MOTOR else column
        found = self._take_number(column, read)
        if found and read == MOTOR:
            self.lines.append(GEARED)
        return found

    def _take_number(self, column: str, read: str) -> bool:
        """Take the column of numbers that looks most like it; read: as which column of a map."""
        if read in self.columns:
            return False
        nouns, kinds, never = NAMED[column]
        moving = {key: series for key, series in self.free.items() if series.numeric}
        if column == "t_s":
            moving = {key: series for key, series in moving.items() if _rises(series)}
        if column == "battery_v":                       # not the number of the battery
            moving = {key: series for key, series in moving.items() if np.nanmax(series.values, initial=0.0) > LEAST_V}
        key = best(moving, column, nouns, kinds, never)
        if key is not None:
            self._take(read, key, unit_said(moving[key], own_unit(read)), unit_note(moving[key], read))
            if column == "hood_deg" and VERTICAL & set(words_of(key)):
                self._from_vertical(read)
        return key is not None

    def _from_vertical(self, column: str) -> None:
        """Have the angle's complement read."""
        unit = self.columns[column].unit
        quarter = round(math.pi / 2.0, 6) if unit == "rad" else 90.0
        self.columns[column] = Signal(self.columns[column].key, unit, times=-1.0, plus=quarter)
        self.lines[-1] += f"; from the vertical, so {quarter:g} less that"

    def _refuse_log(self) -> None:
        """InputError where rows follow each other as those of a log do."""
        said = self.columns.get("t_s")
        series = None if said is None else self.all.get(said.key)
        if said is None or series is None or len(series.values) < LEAST_ROWS or not _rises(series):
            return
        step = float(np.median(np.diff(np.asarray(series.values, dtype=float))))
        step_s = step * {"ms": 1e-3, "us": 1e-6}.get(said.unit, 1.0)
        if step_s < LEAST_STEP_S:
            raise InputError(f"{self.name}: {said.key}: rows are {step_s:.3g} s apart, as of a log, not a shot each; "
                             f"write a map with time.column = \"{said.key}\": docs/how-to/importing.md")

    def _take_text(self, column: str, nouns: set[str]) -> None:
        """A name of the ball or of the day; one of which each shot has its own tells nothing."""
        for key in list(self.free):
            said = set(words_of(key))
            cells = self.tables[0].columns[key]
            if column in self.columns or not nouns & said or said - nouns - NUMBERED or None in cells:
                continue
            if 2 * len(set(cells)) <= len(cells):
                self._take(column, key)

    def _take_order(self) -> None:
        """The shots' numbers: a name for each, and their order in time."""
        for key, series in list(self.free.items()):
            said = set(words_of(key))
            if said - NUMBERED or not (said or key == "#"):
                continue
            if "t_s" not in self.columns and series.numeric and _rises(series):
                self._take("t_s", key, note=": the order of the shots")
            if "shot_id" not in self.columns and self._is_name(key):
                self._take("shot_id", key)

    def _is_name(self, key: str) -> bool:
        """Whether every shot of all tables has another text there."""
        cells = [str(cell or "").strip() for table in self.tables for cell in table.columns.get(key, [None])]
        return all(cells) and len(set(cells)) == len(cells)

    def _outcome(self) -> tuple[OutcomeKeys, list[str]]:
        """The column that says how shots ended, by its name or by its words alone."""
        found = list[tuple[float, int, str, dict[str, str], Counter[str]]]()
        for key, series in self.free.items():
            said = set(words_of(key))
            counts = Counter(outcome_text(cell) for table in self.tables for cell in table.columns.get(key, ()))
            values = meanings(counts)
            if series.numeric and counts.keys() - {""} not in POINTS and counts.keys() - {""} - {"0", "1"}:
                continue
            if weight := _weight(said, values, counts):
                found.append((weight, -len(found), key, values, counts))
        if not found:
            return OutcomeKeys(), [NO_OUTCOME]
        *_, key, values, counts = max(found, key=lambda one: one[:2])
        del self.free[key]
        if "" in counts:
            values[""] = NOT_MARKED[0]
        return OutcomeKeys(key=self._key(key), values=values), outcome_lines(key, values, counts)


def _weight(said: set[str], values: Mapping[str, str], counts: Counter[str]) -> float:
    """How much speaks for a column of outcomes; 0: it has none.

    Of another name than theirs, all its words must be outcomes, a hit and a miss among them, and not just yes and no.
    """
    known = sum(counts[text] for text in values) / max(sum(counts.values()) - counts[""], 1)
    if len(counts) > MOST_WORDS and known < 0.5:
        return 0.0
    if OUTCOME & said and (values or not said - OUTCOME - NUMBERED):
        return 2.0 + known
    words = {word for text, word in values.items() if text not in YES_NO}
    misses = any(word.startswith("miss") or word in ("low", "high") for word in words)
    return 1.0 if known == 1.0 and misses and words & {"hit", "two", "three"} and "side" not in said else 0.0


def _rises(series: Series) -> bool:
    values = np.asarray(series.values, dtype=float)
    return bool(np.isfinite(values).all() and len(values) > 1 and (np.diff(values) > 0.0).all())
