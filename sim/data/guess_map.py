"""Proposed map of a log or table, guessed from its names, units and numbers."""

import csv
import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence, Set
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice, zip_longest
from pathlib import Path

import numpy as np
from msgspec import structs

from truearc.errors import InputError, make_toml
from truearc.robot.config import shot_map as maps
from truearc.robot.config.rig_spec import Rig
from truearc.robot.config.shot_map import MOTOR, OutcomeKeys, ShotMap, Signal, own_unit
from truearc.sim.data import table as cols
from truearc.sim.data.dataset import Floats
from truearc.sim.data.log import TIME, Log, Series, Signals
from truearc.sim.data.mapped_shots import PLACE, Reading, outcome_text, table_below, times
from truearc.sim.data.table import SAID_OF_SHOTS, SPELLINGS, RawTable, is_shot_column, load_table, parse_number, read_as

WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
WANTED = {"set", "setpoint", "target", "goal", "desired", "reference", "ref", "command", "commanded", "requested",
          "wanted", "tgt", "cmd"}
ODD = {"error", "current", "temp", "temperature", "voltage", "volts", "amps", "position", "sigma", "stddev", "std",
       "rate", "accel", "acceleration", "torque", "raw", "offset", "limit", "tolerance", "spread", "kp", "ki", "kd",
       "count"}
SPIN = {"flywheel", "flywheels", "shooter", "wheel", "wheels", "launcher", "top", "bottom", "upper", "lower", "motor"}
SPEED = {"velocity", "speed", "rpm", "rps", "rad", "rads"}
ANGLE = {"angle", "position", "deg", "degrees", "rad", "radians", "elevation", "pitch", "hood"}
OUTCOME = {"outcome", "outcomes", "result", "results", "score", "scored", "hit", "made", "success", "successful"}
FILLERS = {"miss", "missed", "too", ""}                # beside a word that says more
PLAUSIBLE_RAD_S = (20.0, 3000.0)      # of a wheel that throws, at its fastest
MOST_LISTED = 40                      # signals of a message
MOST_WORDS = 12                       # different texts of a signal of outcomes
GEARED = ("motor_rad_s: taken to be the speed of the motors; where it is that of the wheels, divide by the gear: "
          "times = 1 / gear")


def not_recognised(name: str, missing: list[str], found: list[str], moving: Signals, kind: str = "signal",
                   more: str = "") -> InputError:
    """Columns that are missing, those that were recognised, and the signals to choose from, those that change first."""
    def told(series: Series) -> str:
        values = np.asarray(series.values, dtype=float)
        values = values[np.isfinite(values)]
        return (f"  {series.name}: {values.min():.4g} to {values.max():.4g} {unit_said(series, '')}".rstrip()
                if len(values) else f"  {series.name}: no numbers")
    steady = {key: len(np.unique(series.values[:2000])) <= 2 for key, series in moving.items()}
    keys = sorted(moving, key=lambda key: (steady[key], key))
    rest = [f"  and {len(keys) - MOST_LISTED} more"] if len(keys) > MOST_LISTED else []
    first = (f"{name}: no {kind}'s name, unit and numbers look like {', '.join(missing)}; write a map by hand: "
             f"docs/how-to/importing.md{more}")
    return InputError("\n".join([first, *(f"recognised: {line}" for line in found), f"{kind}s with numbers:",
                                 *(told(moving[key]) for key in keys[:MOST_LISTED]), *rest]))


def words_of(key: str) -> list[str]:
    """The words of a key, in small letters: FlywheelRPM has two."""
    return [word.lower() for word in WORD.findall(key)]


def wheel_column(rig: Rig) -> str:
    """The column of a map that a speed is read as."""
    wheels = rig.launcher.wheel
    return MOTOR if rig.launcher.free_speed_rad_s or not wheels else f"wheel_{wheels[0].name}_rad_s"


def unit_said(series: Series, default: str) -> str:
    """The unit that the log states, or that the key ends in; readers of the map do not see the log's metadata."""
    return series.unit or maps.unit_in(series.name) or default


def unit_note(series: Series, column: str) -> str:
    """How a line ends that says which signal a column is."""
    unit = unit_said(series, "")
    return f", in {unit}" if unit else f", whose unit is not stated: taken as {own_unit(column)}"


def best(moving: Signals, column: str, nouns: Set[str], kinds: Set[str], never: Set[str] = WANTED) -> str | None:
    """The signal whose name has one of the nouns, and of the kinds where there are some, whose numbers can be so."""
    scored = [(score, key) for key, series in moving.items()
              if (score := _score(series, words_of(key), column, nouns, kinds, never)) > 0.0]
    return max(scored, key=lambda one: (one[0], -len(one[1])))[1] if scored else None


def _score(series: Series, said: list[str], column: str, nouns: Set[str], kinds: Set[str], never: Set[str]) -> float:
    unit = unit_said(series, "")
    factor = maps.factor_of(column, unit) if unit else None
    of_kind = bool(kinds & set(said)) or factor is not None
    if not nouns & set(said) or (kinds and not of_kind) or never & set(said) or (ODD - kinds - nouns) & set(said):
        return 0.0
    if unit and factor is None:
        return 0.0
    scale, zero = factor or (1.0, 0.0)
    values = (np.asarray(series.values, dtype=float) - zero) * scale
    values = np.abs(values[np.isfinite(values)]) if column == MOTOR else values[np.isfinite(values)]
    low, high = PLAUSIBLE_RAD_S if column == MOTOR else cols.RANGES[column]
    if not (low <= values.max(initial=-np.inf) <= high) or (column != MOTOR and values.min() < low):
        return 0.0
    varies = len(np.unique(values[:2000])) > 3
    return (1.0 + (factor is not None) + varies + 0.5 * len(nouns & set(said)) + (said[-1] in nouns | kinds)
            + 0.5 * bool({"hub", "goal", "speaker", "target"} & set(said)))


def meanings(texts: Iterable[str]) -> dict[str, str]:
    """{text: word of a map} of texts that are known to say how a shot ended; in small letters, without ""."""
    return {text: word for text in texts if text and (word := _meaning_of(text)) is not None}


def _meaning_of(text: str) -> str | None:
    if text in maps.MARKS or text in maps.NOT_MARKED:
        return text
    if text in SPELLINGS:
        return SPELLINGS[text] or maps.NOT_MARKED[0]
    rest = " ".join(word for word in re.split(r"[^\w/]+", text) if word not in FILLERS)
    word = SAID_OF_SHOTS.get(rest, "")
    return SAID_OF_SHOTS.get(text) or (word if word.startswith("miss") else None)


def outcome_lines(key: str, values: Mapping[str, str], counts: Mapping[str, int]) -> list[str]:
    """Which signal says the outcome and what its texts are taken to mean; then those that are not known."""
    meant = [f"{text} = {word}" for text, word in values.items() if text not in ("", word)]
    lines = [f"outcome: {key}" + (f": {', '.join(meant)}" if meant else "")]
    if "" in values:
        lines.append(f"outcome: {key}: empty ({times(counts[''])}): left out")
    odd = [f"{text!r} ({times(counts[text])})" for text in counts if text and text not in values]
    if odd:
        lines.append(f"outcome: {key}: not known: {', '.join(odd)}; add {'them' if odd[1:] else 'it'} to "
                     "outcome.values in shots.toml")
    return lines


PULSE_S = 0.2, 2.0                    # a fall sooner after a shot is none of its outcome's; a pulse is shorter
FALLS = 2                             # of a state, at least
OWN = "truearc"                       # a map that comes with truearc
BOOLEAN = {0.0}, {1.0}, {0.0, 1.0}      # values of such a signal
NO_OUTCOME = "outcome: none found: state outcome in the map, or shots have none"


@dataclass(frozen=True)
class Guess:
    """A map, and a line for each column of how sure it is."""

    map: ShotMap
    lines: tuple[str, ...]

    def to_toml(self) -> str:
        """The map as a shots.toml, with those lines as comments."""
        columns = {name: _plain(said) for name, said in self.map.columns.items()}
        shots = {name: _plain(said) for name in ("wheel", "set_point", "feed")
                 if (said := getattr(self.map.shots, name))}
        outcome = {name: said for name in ("key", "values", "buttons") if (said := getattr(self.map.outcome, name))}
        rows = {} if self.map.rows == "time" else {"rows": self.map.rows}
        table = {"schema": maps.SCHEMA, **rows, "columns": columns, **({"shots": shots} if shots else {}),
                 **({"outcome": outcome} if outcome else {})}
        lines = ("".join(mark if mark.isprintable() else " " for mark in line) for line in self.lines)
        return "".join(f"# {line}\n" for line in lines) + make_toml(table)


def _plain(said: str | Signal) -> str | dict[str, object]:
    return said if isinstance(said, str) else {name: value for name in ("key", "unit", "times", "plus")
                                               if (value := getattr(said, name)) != getattr(Signal(""), name)}


def guess_map(log: Log, rig: Rig, name: str) -> Guess:
    """Propose a map for a log.

    Raises:
        InputError: no signal looks like the speed of a wheel, or like a distance, or like a hood's angle; it lists what
            was recognised and the signals that there are.
    """
    own = maps.load_map(OWN)
    if all(maps.as_signal(said).key in log for said in own.columns.values()):
        return Guess(own, (f"a session of truearc: the map {OWN}",))
    words = {key: words_of(key) for key in log}
    moving = {key: series for key, series in log.items() if series.numeric and len(series.t_s) > 1}
    lines: list[str] = []
    missing: list[str] = []
    columns: dict[str, Signal] = {}
    speed = best(moving, "motor_rad_s", SPIN, SPEED)
    column = wheel_column(rig)
    for wanted, key in (("distance_m", best(moving, "distance_m", {"distance", "dist", "range"}, set())),
                        ("hood_deg", best(moving, "hood_deg", {"hood", "pivot", "elevation", "pitch"}, ANGLE)),
                        (column, speed)):
        if key is None:
            missing.append(wanted)
            continue
        columns[wanted] = Signal(key, unit=unit_said(log[key], own_unit(wanted)))
        lines.append(f"{wanted}: {key}{unit_note(log[key], wanted)}")
    if missing:
        raise not_recognised(name, missing, lines, moving)
    if column == MOTOR:
        lines.append(GEARED)
    battery = best(moving, "battery_v", {"battery", "bus"}, {"voltage", "volts", "v"})
    if battery is not None:
        columns["battery_v"] = Signal(battery, unit=unit_said(log[battery], own_unit("battery_v")))
        lines.append(f"battery_v: {battery}")
    set_point = _set_point(log, words, log[columns[column].key], columns[column].unit)
    feed = _feed(log, words)
    shot_map = ShotMap(maps.SCHEMA, columns={**columns}, shots=maps.Detection(set_point=set_point, feed=feed))
    outcome, marked_by = _outcome(log, words, Reading(Path(name), log, shot_map, rig))
    wanted = set_point.key if set_point else "none found: spinning down may look like a ball"
    lines += [f"set point of the speed: {wanted}",
              f"feeder: {feed or 'none found: every dip of the speed is a shot'}", *marked_by]
    return Guess(structs.replace(shot_map, outcome=outcome), tuple(lines))


def _set_point(log: Log, words: dict[str, list[str]], speed: Series, unit: str) -> Signal | None:
    """A signal of the same words, but wanted, that the speed follows; unit: of the speed, and of it if none is stated.
    """
    mine = set(words_of(speed.name))
    found = []
    for key in log:
        said = set(words[key])
        series = log[key]
        if key == speed.name or not series.numeric or not WANTED & said or not (SPIN | SPEED) & said:
            continue
        if (ODD - {"rad"}) & said:
            continue
        own, theirs = maps.factor_of(MOTOR, unit_said(series, unit)), maps.factor_of(MOTOR, unit)
        if own and theirs and 0.5 * (top := own[0] * _top(series)) < theirs[0] * _top(speed) < 2.0 * top:
            found.append((len(mine & said), -len(said), key))
    return Signal(max(found)[2], unit=unit_said(log[max(found)[2]], unit)) if found else None


def _top(series: Series) -> float:
    values = np.abs(np.asarray(series.values, dtype=float))
    return float(values[np.isfinite(values)].max(initial=0.0))


def _feed(log: Log, words: dict[str, list[str]]) -> str | None:
    """A boolean that names the feeder."""
    nouns = {"feed", "feeder", "feeding", "kicker", "indexer", "trigger", "fire", "firing", "shoot", "shooting"}
    found = [(len(nouns & set(words[key])), -len(words[key]), key) for key, series in log.items()
             if nouns & set(words[key]) and series.numeric and len(series.t_s) > 1
             and set(np.unique(series.values).tolist()) == {0.0, 1.0}]
    return max(found)[2] if found else None


def _outcome(log: Log, words: dict[str, list[str]], reading: Reading) -> tuple[OutcomeKeys, list[str]]:
    """A text of outcomes that are known here, or a boolean that names a hit and stands until the next outcome."""
    found = list[tuple[bool, int, str, dict[str, str], Counter[str]]]()
    for key, series in log.items():
        if not series.numeric and len(set(series.values)) <= MOST_WORDS:
            counts = Counter(str(value).strip().lower() for value in series.changes().values)
            values = meanings(counts)
            named = bool(OUTCOME & set(words[key]))
            # of another name, only the words of maps: that something is in or out is said of more than balls
            if len(values if named else [text for text in values if text in {*maps.MARKS, *maps.NOT_MARKED}]) >= 2:
                found.append((named, -len(found), key, values, counts))
    if found:
        *_, key, values, counts = max(found, key=lambda one: one[:2])
        return OutcomeKeys(key=key, values=values), outcome_lines(key, values, counts)
    nouns = {"scored", "successful", "success", "hit", "made"}
    for key, series in log.items():
        if nouns & set(words[key]) and series.numeric and set(np.unique(series.values).tolist()) in BOOLEAN:
            values, said = _meaning(log[key], reading.shots().t_s)
            return OutcomeKeys(key=key, values=values) if values else OutcomeKeys(), [f"outcome: {key}: {said}"]
    return OutcomeKeys(), [NO_OUTCOME]


def _meaning(scored: Series, shots_s: Floats) -> tuple[dict[str, str], str]:
    """(values of an outcome's boolean, what they are taken to mean); no values where the log leaves that open.

    A state falls by the outcome of a later shot. A pulse falls by itself, whatever comes next.
    """
    edges = scored.changes()
    up = np.flatnonzero(np.asarray(edges.values[:-1]) > 0.5)     # of the last rise without a fall neither counts
    rose, fell = edges.t_s[up], edges.t_s[up + 1]
    state = [bool(((shots_s > up) & (shots_s < down - PULSE_S[0])).any()) for up, down in zip(rose, fell, strict=True)]
    if len(state) >= FALLS and all(state) and (fell - rose > PULSE_S[1]).all():
        return {"true": "hit", "false": "miss"}, "true is a hit, false a miss"
    if state and not any(state) and (fell - rose < PULSE_S[1]).all():
        return {"true": "hit"}, ("is true for a moment after a hit; shots without it are left out. If they missed, "
                                 "state outcome.otherwise = \"miss\"")
    return {}, "left out: it may be a state or a pulse; state outcome in the map, or shots have none"


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
        with cols.gathered() as problems:
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


def _series(name: str, cells: list[cols.Cell]) -> Series | None:
    """Numbers where most cells are: the others are named as the table is read."""
    rows = [row for row, cell in enumerate(cells) if cell is not None and str(cell).strip()]
    if not rows:
        return None
    numbers = [parse_number(cells[row]) for row in rows]
    last = words_of(name)[-1:]
    unit = maps.unit_in(name) or (maps.UNITS.get(last[0], "") if last else "")
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
        return Guess(ShotMap(maps.SCHEMA, rows="shot", columns={**self.columns}, outcome=outcome), tuple(self.lines))

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
        if column == "side" and {str(value).lower() for value in series.values} - {*cols.SIDES}:
            return
        if column == "shot_id" and not self._is_name(key):
            return
        own = own_unit(column)
        plain = "_".join(key.lower().split())
        suffix = plain[len(column) - len(maps.unit_of(column)):] if own else ""
        self._take(column, key, suffix, f", in {suffix}" if suffix else "")

    def _take_needed(self, column: str) -> bool:
        if column in self.columns or any(one in self.columns for one in INSTEAD.get(column, ())):
            return True
        if column == MOTOR and any(maps.WHEEL.fullmatch(one) for one in self.columns):
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
            values[""] = maps.NOT_MARKED[0]
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
