"""Proposed map of a log or table, guessed from its names, units and numbers."""

import math
import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence, Set
from itertools import chain, pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from msgspec import UNSET, structs

from truearc.errors import InputError
from truearc.robot.config import shot_map as maps
from truearc.robot.config import units
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.shot_map import OutcomeKeys, ShotMap, Signal, TimeColumn
from truearc.robot.config.units import MOTOR, own_unit
from truearc.sim.data import table as cols
from truearc.sim.data.dataset import Floats
from truearc.sim.data.log import TIME, Log, Series, spikes, state_or_pulse
from truearc.sim.data.mapped_shots import PLACE, SECONDS, SPEED, Reading, outcome_text, times
from truearc.sim.data.table import SAID_OF_SHOTS, SERVO, SPELLINGS, RawTable, is_shot_column, parse_number, read_as

WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
POINTS = {"0", "1"}, {"0", "2", "3"}  # outcomes as numbers
SPANS = {**cols.RANGES, MOTOR: (20.0, 3000.0), SERVO: (0.0, 1.0)}     # of a wheel that throws; of a servo
NEARLY_ALL = 0.9                      # share of the numbers that are within the span: -1 is often none
MOST_RAD = 1.6                        # angles up to here are no degrees
EPOCH = (("us", 1e14), ("ms", 1e11), ("s", 0.0))       # units of times since 1970, by their size
TYPICAL = {"distance_m": 4.0, "hood_deg": 42.0, MOTOR: 400.0}         # by which the likelier unit is told
MOST_NEAR = 3                         # signals of a column's name that are named with what their numbers are
MOST_LISTED = 40                      # signals of a message
MOST_WORDS = 12                       # different texts of a signal of outcomes
LEAST_V = 5.0                         # of a battery; less is its number
LEAST_STEP_S, LEAST_ROWS, REGULAR = 0.5, 20, 0.2       # rows of a log are closer, and so many; evenly apart
MOST_CHANGES = 0.05                   # share of a log's rows whose outcome is not that of the row before
OWN = "truearc"                       # a map that comes with truearc
NO_OUTCOME = "outcome: none found: state outcome in the map, or shots have none"
GEARED = ("motor_rad_s: {key} is taken to be the motors' speed: by its gear, {gears}; if these are the wheels' own "
          "speeds, state times = {times} for it in the map")
TWO_POINTS = (": a servo's position, not an angle; measure two angles or more, and state them in rig.toml: "
              "[launcher.hood] map = [[0.2, 35.0], [0.8, 58.0]]")
HIT_OR_MISS = ("; a hit may be a two or a three: where all count alike, state target.three_half_height_m = 0 in "
               "rig.toml")
SCORES = {"two", "three"}
# of words in a text, what counts
ORDER = ["miss", "hit", "miss-left", "miss-right", "miss-low", "miss-high", "three", "two", "rejected"]
CERTAIN = {**SAID_OF_SHOTS, **{text: word or maps.NOT_MARKED[0] for text, word in SPELLINGS.items()},
           **{word: word for word in (*maps.MARKS, *maps.NOT_MARKED)}}
# words of outcomes that may be a miss, too -> what is proposed
OPEN = {text: word for word, texts in cols.VOCABULARY["open"].items() for text in texts}


def _words(listed: Sequence[str]) -> frozenset[str]:
    """The words of a list of words.toml, and of the groups that it names."""
    return frozenset(one for word in listed
                     for one in (_words(cols.VOCABULARY["groups"][word[1:]]) if word.startswith("@") else (word,)))


GROUPS = {name: _words(listed) for name, listed in cols.VOCABULARY["groups"].items()}
# column -> words of a signal's name: nouns, loose, kinds, never (words.toml)
NAMED = {column: [_words(kinds.get(kind, ())) for kind in ("nouns", "loose", "kinds", "never")]
         for column, kinds in cols.VOCABULARY["names"].items()}
# what is needed -> the other columns that stand for it
NEEDED = {"distance_m": (), "hood_deg": ("exit_deg",), MOTOR: ("motor_ratio", "exit_speed_m_s")}


class NoSuchOutcomeError(InputError):
    """Words whose meaning was given are not in the data."""

    def __init__(self, message: str, absent: Sequence[str]) -> None:
        super().__init__(message)
        self.absent = absent


class Guess(NamedTuple):
    """A map, and a line for each column of how sure it is.

    asked: a question about words of outcomes whose meaning is not certain, "" for none; nothing is imported before it
    is answered. proposed: what each word of the outcomes may mean.
    """

    map: ShotMap
    lines: tuple[str, ...]
    asked: str
    proposed: Mapping[str, str]

    def to_toml(self) -> str:
        """The map as a shots.toml, with those lines as comments."""
        lines = ("".join(mark if mark.isprintable() else " " for mark in line) for line in self.lines)
        return "".join(f"# {line}\n" for line in lines) + maps.to_toml(self.map)


def words_of(key: str) -> list[str]:
    """The words of a key, in small letters: FlywheelRPM has two."""
    return [word.lower() for word in WORD.findall(key)]


def says(key: str, *groups: str) -> Set[str]:
    """The words of a key that are in one of some groups of words.toml."""
    return {*words_of(key)} & frozenset().union(*(GROUPS[group] for group in groups))


def unit_said(series: Series) -> str:
    """The unit that the log states, or that the key ends in; readers of the map do not see the log's metadata."""
    return series.unit or units.unit_in(series.name)


def unit_seen(series: Series, column: str) -> str:
    """The unit that the numbers have by their size, where that is certain; else ""."""
    top = _top(series)
    if column == "hood_deg" and top <= MOST_RAD and says(series.name, "tilt"):
        return "rad"
    return next(unit for unit, least in EPOCH if top > least) if column == "t_s" and top > EPOCH[1][1] else ""


def _top(series: Series) -> float:
    """The largest magnitude that is no single wild sample."""
    values = np.asarray(series.values, dtype=float)
    values = np.abs(values[np.isfinite(values)])
    return float(values[~spikes(values)].max(initial=0.0))


def time_column(table: RawTable) -> TimeColumn | None:
    """The column of time of a log; None of a table with a row per shot, whose times are further apart, or where each
    row has an outcome."""
    if any(says(name, "outcome") and _one_a_row([*map(outcome_text, cells)]) for name, cells in table.columns.items()):
        return None
    for name in sorted(table.columns, key=lambda name: name != TIME):
        numbers = np.array([number for cell in table.columns[name] if (number := parse_number(cell)) is not None])
        if (not says(name, "times") or says(name, "durations")
                or len(numbers) < max(LEAST_ROWS, 0.5 * len(table.lines))):
            continue
        steps = np.abs(np.diff(numbers))
        step = float(np.median(steps))
        loops = name == TIME and step >= 5.0 and np.median(np.abs(steps - step)) <= REGULAR * step       # no seconds
        series = Series(name, numbers, numbers)
        unit = unit_said(series) or unit_seen(series, "t_s")
        unit = unit if unit in SECONDS else "s" if not loops else "ms" if step < 5000.0 else "us"
        if step / SECONDS[unit] < LEAST_STEP_S:
            return TimeColumn(name, unit)              # type: ignore[arg-type]
    return None


def guess_map(source: Log | Sequence[RawTable], rig: Rig, name: str, *, time: TimeColumn, has_three: bool,
              outcomes: Mapping[str, str] | None) -> Guess:
    """Propose a map for a log, or for tables whose rows are shots.

    Args:
        source: The log, or the tables, whose columns are those of the first.
        rig: Whose launcher and target it is of.
        name: Of the file, for messages.
        time: The log's column of time.
        has_three: Whether the height of a three is stated, so that a hit may be a two or a three.
        outcomes: What words of outcomes mean: word of the data -> word of a map.

    Raises:
        InputError: no signal looks like a distance, an angle or a speed; it lists what was recognised and the signals
            that there are. Or a word of `outcomes` is not in the data, or its meaning is none of a map.
    """
    own = maps.load_map(OWN) if OWN in maps.installed() else ShotMap(maps.SCHEMA)
    if own.columns and all(maps.as_signal(said).key in source for said in own.columns.values()):
        return Guess(own, (f"a session of truearc: the map {OWN}",), "", {})
    return _Guessing(source, rig, name).guess(time, has_three, outcomes or {})


class _Guessing:
    """A map in the making: columns of shots are taken one by one, and no signal twice."""

    def __init__(self, source: Log | Sequence[RawTable], rig: Rig, name: str) -> None:
        self.tables: Sequence[RawTable] = () if isinstance(source, Log) else source
        self.rig, self.name = rig, name
        self.all = source if isinstance(source, Log) else {
            key: series for key, cells in source[0].columns.items() if (series := _series(key, cells)) is not None}
        self.free = {**self.all}                       # that are not taken yet
        self.columns: dict[str, Signal] = {}
        self.lines: list[str] = []

    def guess(self, time: TimeColumn, has_three: bool, outcomes: Mapping[str, str]) -> Guess:
        """Names that shots.csv has come first, then what is needed, outcomes, and what is of use."""
        found = self._find_outcome()
        for key in list(self.free) if self.tables else ():
            self._take_own(key)
        self._take_needed()
        for column in ("battery_v", "temperature_c", "t_s") if self.tables else ("battery_v",):
            self.lines += [] if column in self.columns else self._take_number(column, column) or []
        if self.tables:
            self._take_texts()
        shot_map = ShotMap(maps.SCHEMA, rows="shot" if self.tables else "time", columns={**self.columns}, time=time,
                           shots=maps.Detection() if self.tables else self._detection())
        outcome, asked, proposed = (self._boolean(shot_map, outcomes) if found is None else
                                    self._read_words(*found, has_three, outcomes))
        if self.tables and self.free:
            self.lines.append(f"not used: {', '.join(self.free)}")
        return Guess(structs.replace(shot_map, outcome=outcome), tuple(self.lines), asked, proposed)

    # --- columns

    def _take(self, column: str, key: str, unit: str = "", note: str = "") -> None:
        self.columns[column] = Signal(self._key(key), unit=unit)
        self.lines.append(f"{column}: {key}{note}")
        self.free.pop(key, None)

    def _key(self, key: str) -> str:
        """A column as a map names it: one that is called #2 by its place."""
        return f"#{list(self.tables[0].columns).index(key) + 1}" if self.tables and PLACE.fullmatch(key) else key

    def _take_own(self, key: str) -> None:
        """A column that is called as one of shots.csv."""
        column, *_ = read_as(key, is_shot_column)
        other_sides = {str(value).lower() for value in self.free[key].values} - {*cols.SIDES}
        if (not is_shot_column(column) or column in ("outcome", SERVO, "day", *self.columns)
                or (column == "side" and other_sides) or (column == "shot_id" and not self._is_name(key))):
            return
        plain = "_".join(key.lower().split())
        suffix = plain[len(column) - len(units.unit_of(column)):]
        self._take(column, key, suffix, f", in {suffix}" if suffix else "")

    def _take_needed(self) -> None:
        """Distance, angle and speed; InputError where one is found nowhere."""
        wheels = self.rig.launcher.wheel
        speed = MOTOR if self.rig.launcher.free_speed_rad_s or not wheels else f"wheel_{wheels[0].name}_rad_s"
        missing = dict[str, list[str]]()               # column of a map: lines on what is not that
        for column, instead in NEEDED.items():
            have = {MOTOR if units.WHEEL.fullmatch(one) else one for one in self.columns}
            read = speed if column == MOTOR else column
            if have & {column, *instead} or (column == MOTOR and self._take_wheels()):
                continue
            others = [(one, one) for one in (*instead, *[SERVO] * (column == "hood_deg"))
                      if one in NAMED and (self.tables or one == SERVO)]
            nearly = self._take_number(column, read)
            if nearly is not None and all(self._take_number(*one) is not None for one in others):
                missing[read] = nearly
        if missing:
            raise self._not_recognised(missing)

    def _take_wheels(self) -> bool:
        """Take the speeds of the rig's wheels where signals name each; a single wheel may be called so. Return whether.
        """
        wheels, before = self.rig.launcher.wheel, ({**self.free}, {**self.columns}, [*self.lines])
        for wheel in wheels:
            called = [{*words_of(wheel.name)}, *([{"wheel"}] if len(wheels) == 1 else [])]
            keys = [key for key in self.free if "motor" not in (said := words_of(key))
                    and any(one <= {*said} for one in called)]
            if self._take_number(MOTOR, f"wheel_{wheel.name}_rad_s", keys) is not None:
                self.free, self.columns, self.lines = before
                return False
        return bool(wheels)

    def _take_number(self, column: str, read: str, keys: Collection[str] | None = None) -> list[str] | None:
        """Take the signal of numbers that looks most like a column; read: as which column of a map; keys: of which
        signals. Where none does, return lines on signals of such names, and why they are not that."""
        scored = [(*self._score(series, column), -len(key), key) for key, series in self.free.items()
                  if (self.tables or len(series.t_s) > 1) and (keys is None or key in keys)]
        fit = [(score, length, key) for score, unfit, length, key in scored if score > 0.0 and not unfit]
        if not fit:
            return [f"{column}: not {key}: {unfit}" for score, unfit, _, key in scored if score > 0.0][:MOST_NEAR]
        *_, key = max(fit, key=lambda one: one[:2])
        stated, seen = unit_said(self.free[key]), unit_seen(self.free[key], column)
        note = (f", in {stated}" if stated else f", in {seen} by the size of its numbers" if seen else
                f", whose unit is not stated: taken as {own_unit(read)}" if own_unit(read) else "")
        self._take(read, key, stated or seen or own_unit(read), note)
        if column in ("hood_deg", "exit_deg") and says(key, "vertical"):
            quarter = 90.0 if self.columns[read].unit != "rad" else round(math.pi / 2.0, 6)
            self.columns[read] = structs.replace(self.columns[read], times=-1.0, plus=quarter)
            self.lines[-1] += f"; from the vertical, so {quarter:g} less that"
        if read == SERVO:
            self.lines[-1] += TWO_POINTS if self.rig.launcher.hood is UNSET else ", an angle by launcher.hood.map"
        gears = {wheel.name: wheel.gear for wheel in self.rig.launcher.wheel}
        if read == MOTOR and {*gears.values()} - {1.0}:
            turning = " and ".join(f"wheel {name} turns {gear:g} times as fast" for name, gear in gears.items())
            own = "1 / gear" if len({*gears.values()}) > 1 else f"{1.0 / min(gears.values()):g}"
            self.lines.append(GEARED.format(key=key, gears=turning, times=own))
        return None

    def _score(self, series: Series, column: str) -> tuple[float, str]:
        """How much a signal looks like a column by its name and unit, 0 where it cannot be that, and what its numbers
        have against it."""
        (nouns, loose, kinds, never), words = NAMED[column], words_of(series.name)
        said, nouns = set(words), nouns | (loose if self.tables or len(self.all) < MOST_LISTED else frozenset())
        unit = unit_said(series) or (unit_seen(series, column) if series.numeric else "")
        factor = units.factor_of(column, unit) if unit else None
        numbers = np.asarray(series.values, dtype=float) if series.numeric else np.zeros(1)
        if (not nouns & said or (never | (GROUPS["odd"] - kinds - nouns)) & said or not np.isfinite(numbers).any()
                or (factor is None and (unit or (kinds and not kinds & said)))):
            return 0.0, ""
        if not series.numeric:
            return 1.0, f"holds texts, such as {series.values[0]!r}; write numbers alone"
        varies = len(np.unique(numbers[:2000])) > 3
        return (1.0 + (factor is not None) + varies + 0.5 * len(nouns & said) + (words[-1] in nouns | kinds)
                + 0.5 * bool({"hub", "goal", "speaker", "target"} & said)), self._unfit(column, series, unit)

    def _unfit(self, column: str, series: Series, unit: str) -> str:
        """Why the numbers of a signal cannot be such as a column has, and what may help; "" where they can."""
        numbers, own = np.asarray(series.values, dtype=float), own_unit(column)
        rows, numbers = series.t_s[np.isfinite(numbers)], numbers[np.isfinite(numbers)]
        low, high = SPANS[column]

        def read(unit: str) -> Floats:
            scale, zero = units.factor_of(column, unit) or (1.0, 0.0)
            return np.asarray(np.abs(numbers * scale) if column == MOTOR else (numbers - zero) * scale)

        def outside(values: Floats) -> np.ndarray:
            """Those out of the range; all where too many are. One cell alone is named when the table is read."""
            wrong = (values > high) | ((values < low) & (column != MOTOR))
            return np.asarray((wrong & (wrong.mean() > 1.0 - NEARLY_ALL)) | (values.max() < low))
        values, steps = read(unit), np.diff(numbers)
        top, wrong = float(values.max()), np.flatnonzero(outside(values))
        turns = np.flatnonzero(steps * (np.median(np.sign(steps) if steps.size else 0.0) or 1.0) < 0.0)
        if column == "t_s" and (turns.size or (steps.size and not steps.any())):
            at = turns[0] + 1 if turns.size else 1
            return (f"{numbers[at]:.15g} in {self._place(rows[at])} comes after {numbers[at - 1]:.15g}; sort the rows, "
                    "or name their sessions in a column session")
        if (column == "battery_v" and top <= LEAST_V) or (column == "hood_deg" and not unit and top <= MOST_RAD) or (
                column == SERVO and (unit or {*np.unique(values)} == {0.0, 1.0})):
            return f"up to {top:.4g}, it looks like another thing"       # a servo's position, the number of a battery
        if not wrong.size:
            return ""
        others = {one: read(one) for one in (own, *units.CONVERTED.get(own, ())) if one != (unit or own)}
        likely = min((one for one in others if not outside(others[one]).any()), default="", key=lambda one: abs(
            math.log(max(np.median(others[one]), 1e-9) / TYPICAL.get(column, 1.0))))
        what = f"{numbers[wrong[0]]:g} in {self._place(rows[wrong[0]])} is" if 2 * wrong.size < len(numbers) else (
            f"{numbers.min():.4g} to {numbers.max():.4g} are")
        looks = f"; these look like {likely}: rename it to {units.in_unit(series.name, likely)}" if likely else ""
        return f"{what} beyond {low:g} to {high:g} {own}{f', in {unit}' if unit not in ('', own) else ''}{looks}"

    def _place(self, row: float) -> str:
        """Where a row of a table is, or when one of a log."""
        return self.tables[0].place(int(row)) if self.tables else f"t = {row:.2f} s"

    def _take_texts(self) -> None:
        """Names of the ball, session, day and person, unless each shot has its own; the shots' numbers, as names and
        order."""
        for key, series in list(self.free.items()):
            said, cells = set(words_of(key)), self.tables[0].columns[key]
            texts = [column for column in cols.TEXTS if column not in self.columns and GROUPS[column] & said
                     and not said - GROUPS[column] - GROUPS["numbered"]]
            if texts and None not in cells and 2 * len(set(cells)) <= len(cells):
                self._take(texts[0], key)
            numbered = not said - GROUPS["numbered"] and (said or key == "#")
            if numbered and "t_s" not in self.columns and series.numeric and len(series.t_s) > 1 and (
                    np.diff(np.asarray(series.values, dtype=float)) > 0.0).all():
                self._take("t_s", key, note=": the order of the shots")
            if numbered and "shot_id" not in self.columns and self._is_name(key):
                self._take("shot_id", key)

    def _is_name(self, key: str) -> bool:
        """Whether every shot of all tables has another text there."""
        cells = [str(cell or "").strip() for table in self.tables for cell in table.columns.get(key, [None])]
        return all(cells) and len(set(cells)) == len(cells)

    def _not_recognised(self, missing: dict[str, list[str]]) -> InputError:
        """Columns that are missing, those that were recognised, and the signals to choose from, those that change
        first."""
        kind = "column" if self.tables else "signal"
        moving = {key: numbers for key, series in self.all.items() if isinstance(series.values, np.ndarray)
                  and len(numbers := series.values[np.isfinite(series.values)])}
        keys = sorted(moving, key=lambda key: (len(np.unique(moving[key][:2000])) <= 2, key))
        return InputError("\n".join([
            f"{self.name}: no {kind}'s name, unit and numbers look like {', '.join(missing)}; write a map by "
            "hand: docs/how-to/importing.md", *(self.all.damage if isinstance(self.all, Log) else ()),
            *(f"recognised: {line}" for line in self.lines),
            *chain(*missing.values()), f"{kind}s with numbers:",
            *(f"  {key}: {min(moving[key]):.4g} to {max(moving[key]):.4g} {unit_said(self.all[key])}".rstrip()
              for key in keys[:MOST_LISTED]),
            *[f"  and {len(keys) - MOST_LISTED} more"] * (len(keys) > MOST_LISTED)]))

    # --- how shots are found in a log

    def _detection(self) -> maps.Detection:
        """The set point: a signal of the speed's words, but wanted, that the speed follows. The feeder: a boolean that
        names it."""
        speed = next(said for column, said in self.columns.items() if SPEED.fullmatch(column))
        scale, _ = units.factor_of(MOTOR, speed.unit) or (1.0, 0.0)
        top, own = scale * _top(self.all[speed.key]), {*words_of(speed.key)}

        def follows(key: str, series: Series) -> bool:
            factor = units.factor_of(MOTOR, unit_said(series) or speed.unit)
            return bool(factor and key != speed.key and says(key, "wanted") and says(key, "spin", "speed")
                        and not says(key, "odd") - {"rad"}
                        and 0.5 < top / (factor[0] * _top(series) or np.inf) < 2.0)
        found = [(key, series, says(key, "feeder"), -len({*words_of(key)})) for key, series in self.all.items()
                 if series.numeric]
        *_, point = max(((len(own & {*words_of(key)}), less, key) for key, series, _, less in found
                         if follows(key, series)), default=("",))
        *_, feed = max(((len(feeds), less, key) for key, series, feeds, less in found
                        if feeds and {*np.unique(series.values)} == {0.0, 1.0}), default=("",))
        self.lines += [f"set point of the speed: {point or 'none found: spinning down may look like a ball'}",
                       f"feeder: {feed or 'none found: every dip of the speed is a shot'}"]
        return maps.Detection(set_point=Signal(point, unit=unit_said(self.all[point]) or speed.unit) if point else None,
                              feed=feed or None)

    # --- outcomes

    def _find_outcome(self) -> tuple[str, Counter[str]] | None:
        """The signal that says how shots ended, by its name or by its words alone, and how often it says which."""
        found, rest = list[tuple[float, int, str, Counter[str]]](), list[str]()
        for key, series in self.free.items():
            cells = ([outcome_text(cell) for table in self.tables for cell in table.columns.get(key, ())] if self.tables
                     else [] if series.numeric else [maps.plain(value) for value in series.changes().values])
            counts = Counter(cells)
            if weight := self._weight(key, counts):
                found.append((weight, -len(found), key, counts))
            elif self.tables and _is_named(key, counts):
                rest.append(f"outcome: not {key}: {next(text for text, _ in counts.most_common() if text)!r} and the "
                            "like are no outcomes; write words, or 0, 2 and 3, or 0 and 1")
        if not found:
            self.lines += rest
            return None
        *_, key, counts = max(found, key=lambda one: one[:2])
        del self.free[key]
        return key, counts

    def _weight(self, key: str, counts: Counter[str]) -> float:
        """How much speaks for a signal of outcomes; 0: it has none.

        Of another name than theirs, all its words must be outcomes, a hit and a miss among them, and not just yes and
        no; in a log, where more than balls is in or out, words of maps.
        """
        said, named, texts = {*words_of(key)}, _is_named(key, counts), counts.keys() - GROUPS["idle"]
        if all(parse_number(text) is not None for text in texts) and not any(texts <= points for points in POINTS):
            return 0.0
        words = {text: word for text in counts if text and (word := _meaning(text) or OPEN.get(text))
                 and (named or self.tables or text in maps.MARKS or text in maps.NOT_MARKED)}
        known = sum(counts[text] for text in words) / max(sum(counts.values()) - counts[""], 1)
        if len(counts) > MOST_WORDS and known < 0.5:
            return 0.0
        if named and (words or not said - GROUPS["outcome"] - GROUPS["numbered"]) and (self.tables or len(words) > 1):
            return 2.0 + known
        marks = {word for text, word in words.items() if text not in GROUPS["yes_no"]}
        misses = any(word.startswith("miss") or word in ("low", "high") for word in marks)
        return 1.0 if known == 1.0 and misses and marks & {"hit", "two", "three"} and "side" not in said else 0.0

    def _read_words(self, key: str, counts: Counter[str], has_three: bool, given: Mapping[str, str]
                    ) -> tuple[OutcomeKeys, str, dict[str, str]]:
        """(what words mean whose meaning is certain or given, a question about the others, what is proposed of all)."""
        given = {maps.plain(text): word for text, word in given.items()}
        if absent := [text for text in given if text not in counts]:
            raise NoSuchOutcomeError(f"{self.name}: {key}: no outcome is called {', '.join(absent)}; there are "
                                     f"{', '.join(filter(None, counts))}", absent)
        for text, word in given.items():
            if word not in maps.MARKS and word not in maps.NOT_MARKED:
                raise InputError(f"{self.name}: {key}: {text} = {word}: is none of {', '.join(maps.MARKS)}, rejected")
        words = {text: given.get(text) or _meaning(text) for text in counts
                 if text and (self.tables or text not in GROUPS["idle"])}
        target = self.rig.target
        hit = "three" if target and not target.hit_or_miss and (has_three or "three" in words.values()) else "hit"
        unclear = [text for text, word in words.items() if word is None or (word == "hit" and hit == "three")]
        proposed = {text: hit if word == "hit" else word or _proposed(text, hit) for text, word in words.items()}
        values = {text: word for text, word in words.items() if word and text not in unclear}
        meant = [f"{text} = {word}" for text, word in values.items() if text != word]
        self.lines.append(f"outcome: {key}" + (f": {', '.join(meant)}" if meant else ""))
        if self.tables and "" in counts:
            self.lines.append(f"outcome: {key}: empty ({times(counts[''])}): left out")
            values[""] = maps.NOT_MARKED[0]
        asked = (f"{self.name}: {key}: the meaning is not certain of "
                 f"{', '.join(f'{text!r} ({times(counts[text])})' for text in unclear)}"
                 f"{HIT_OR_MISS if any(words[text] for text in unclear) else ''}. Proposed: "
                 f"{', '.join(f'{text} = {word}' for text, word in proposed.items() if text != word)}")
        return OutcomeKeys(key=self._key(key), values=values), asked if unclear else "", proposed

    def _boolean(self, shot_map: ShotMap, given: Mapping[str, str]) -> tuple[OutcomeKeys, str, dict[str, str]]:
        """A boolean of a log that names a hit."""
        if given:
            raise InputError(f"{self.name}: outcomes: {', '.join(given)}: there is no signal of outcomes")
        for key, series in () if self.tables else self.all.items():
            if says(key, "scored") and series.numeric and set(np.unique(series.values)) <= {0.0, 1.0}:
                shots = Reading(Path(self.name), Log(self.all), shot_map, self.rig).shots()
                values, said = state_or_pulse(series, shots.t_s)
                self.lines.append(f"outcome: {key}: {said}")
                return OutcomeKeys(key=key, values=values) if values else OutcomeKeys(), "", {}
        self.lines.append(NO_OUTCOME)
        return OutcomeKeys(), "", {}


def _series(name: str, cells: list[cols.Cell]) -> Series | None:
    """A table's column: numbers where most cells are, as the others are named when the table is read."""
    filled = {row: str(cell).strip() for row, cell in enumerate(cells) if cell is not None and str(cell).strip()}
    numbers, t_s = [parse_number(cells[row]) for row in filled], np.array([*filled], dtype=float)
    texts = 2 * numbers.count(None) >= len(numbers)
    return Series(name, t_s, tuple(filled.values()) if texts else np.array(numbers, dtype=float), each_row=True
                  ) if filled else None


def _one_a_row(texts: Sequence[str]) -> bool:
    """Whether texts are outcomes of a shot each: a log says the same one in many rows."""
    changes = sum(one != other for one, other in pairwise(texts))
    return changes > MOST_CHANGES * len(texts) and {*texts} <= (CERTAIN.keys() | OPEN.keys()) - {""}


def _is_named(key: str, counts: Counter[str]) -> bool:
    """Whether a signal is called as outcomes are; one such as Ball in, by yes and no, too, as distances are in inches.
    """
    went_in = "in" in {*words_of(key)} <= GROUPS["went_in"] and counts.keys() - {""} <= GROUPS["yes_no"]
    return went_in or bool(says(key, "outcome"))


def _meaning(text: str) -> str | None:
    """What a text says of a shot, as a word of a map; None where that is not certain."""
    rest = " ".join(word for word in re.split(r"[^\w/]+", text) if word not in GROUPS["fillers"])
    word = SAID_OF_SHOTS.get(rest, "")
    return CERTAIN.get(text, word if word.startswith("miss") else None)


def _proposed(text: str, hit: str) -> str:
    """The likeliest meaning of a text whose words are known, if at all, one by one: off the rim, a ball is in or out.
    """
    if len(text) == 1 and text.isalpha():
        return "?"                    # t may be three or timeout, x a hit or a miss: the command asks
    parts = [text, *re.findall(r"\d[\d.]*|[^\W\d_]+", text)]
    certain, open_ = ([known[one] for one in parts if known.get(one)] for known in (SPELLINGS | SAID_OF_SHOTS, OPEN))
    word = min(certain, key=ORDER.index, default="") or min(open_, key=ORDER.index, default=maps.NOT_MARKED[0])
    word = next(filter(SCORES.__contains__, open_ + certain), hit) if word == "hit" else word
    return hit if word in SCORES and hit == "hit" else word
