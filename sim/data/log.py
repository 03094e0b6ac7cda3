"""A robot log in memory, and the detection of its shots from dips in wheel speed."""

from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from truearc.errors import InputError
from truearc.sim.data.dataset import Floats
from truearc.sim.data.table import Cell, RawTable, gathered, load_table, parse_number

BACK_US = 1_000_000                   # a signal's values of several writers may be out of order by less
TRUE, FALSE = "true", "false"
TIME, KEY, VALUE = "Timestamp", "Key", "Value"          # header of AdvantageScope's CSV list


@dataclass(frozen=True)
class Series:
    """One signal: times [n] in s, non-decreasing; values [n], numbers or texts; the unit that the log states, or "".

    A boolean is 1 or 0. `each_row`: there is a value at every time of the log, whether it is new or not.
    """

    name: str
    t_s: Floats
    values: Floats | tuple[str, ...]
    unit: str = ""
    each_row: bool = False

    @property
    def numeric(self) -> bool:
        return isinstance(self.values, np.ndarray)

    def before(self, t_s: float) -> float | str | None:
        """Return the newest value at or before that time; None if there is none yet."""
        place = int(np.searchsorted(self.t_s, t_s, side="right")) - 1
        return None if place < 0 or self.values[place] == "" else self.values[place]

    def changes(self) -> "Series":
        """Return the series without samples that repeat the previous one."""
        if len(self.t_s) < 2:
            return self
        values = self.values if isinstance(self.values, np.ndarray) else np.array(self.values, dtype=object)
        new = np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1]]))
        kept = self.values[new] if isinstance(self.values, np.ndarray) else tuple(values[new])
        return Series(self.name, self.t_s[new], kept, self.unit)


Signals = Mapping[str, Series]


class Log(dict[str, Series]):
    """The signals of a log by name; `damage`: a line for each kind of damage to its file."""

    def __init__(self, signals: Signals, damage: tuple[str, ...] = ()) -> None:
        super().__init__(signals)
        self.damage = damage


def read_csv_log(path: Path, time: str, second: float) -> Log:
    """Read the signals of a CSV file: AdvantageScope's list (Timestamp, Key, Value), or a table with a column per
    signal.

    time: the column of time. second: how many of its units are one.

    Raises:
        InputError: a cell of the time is not a number, or the column is missing.
    """
    with gathered() as problems:
        table = load_table(path, problems)
    return log_of(table, time, second)


def log_of(table: RawTable, column: str, second: float) -> Log:
    """Signals of a table, as read_csv_log returns them."""
    if column not in table.columns:
        raise InputError(f"{table.place(-1)}: there is no column {column!r} of time ({', '.join(table.columns)})")
    t_s = np.array([_time(table, row, cell) for row, cell in enumerate(table.columns[column])]) / second
    if {KEY, VALUE} <= set(table.columns):
        return _of_list(table, t_s)
    return Log({name: series for name, cells in table.columns.items()
                if name != column and (series := _of_cells(name, t_s, cells, each_row=True)) is not None},
               _backwards([t_s]))


def _time(table: RawTable, row: int, cell: Cell) -> float:
    number = parse_number(cell)
    if number is None or not np.isfinite(number):
        raise InputError(f"{table.place(row)}: {cell!r} is not a time")
    return number


def _of_list(table: RawTable, t_s: Floats) -> Log:
    rows: dict[str, list[int]] = {}
    for row, key in enumerate(table.columns[KEY]):
        rows.setdefault(str(key or ""), []).append(row)
    cells = table.columns[VALUE]
    found = {key: _of_cells(key, t_s[mine], [cells[row] for row in mine]) for key, mine in rows.items()}
    return Log({key: series for key, series in found.items() if series is not None},
               _backwards([t_s[mine] for mine in rows.values()]))


def _backwards(times: list[Floats]) -> tuple[str, ...]:
    """A line on how often time goes back in series of rows, as where a part of the file stands in another's place."""
    count = sum(np.count_nonzero(np.diff(t_s) < -BACK_US * 1e-6) for t_s in times)
    return (f"damaged: time goes back in {count} rows; shots may be missing",) if count else ()


def _of_cells(name: str, t_s: Floats, cells: list[Cell], each_row: bool = False) -> Series | None:
    """Numbers where every cell that is filled is one, or a boolean."""
    filled = [row for row, cell in enumerate(cells) if cell is not None and str(cell).strip() not in ("", "null")]
    if not filled:
        return None
    order = sorted(filled, key=lambda row: t_s[row])
    numbers = [_number(cells[row]) for row in order]
    if any(number is None for number in numbers):
        order = sorted(range(len(cells)), key=lambda row: t_s[row]) if each_row else order     # "" is a word, too
        return Series(name, t_s[order], tuple(str(cells[row] or "").strip() for row in order), "", each_row)
    return Series(name, t_s[order], np.array(numbers, dtype=float), "", each_row)


def _number(cell: Cell) -> float | None:
    word = str(cell).strip().lower()
    return 1.0 if word == TRUE else 0.0 if word == FALSE else parse_number(cell)


# --- shots

FALL_S = 0.15                         # a ball slows the wheels within this
RECOVER_S = 1.0                       # and they are faster again within this, where no set point says that they fell
STEEP = 0.05                          # share of its greatest step that a fall has where it has begun
REGAINED = 0.5                        # share of the dip after which the next one may begin
EDGES = 2                             # samples of another signal at the edges of a part that is lost
RATES = 4.0                           # times as long as usual between two samples: some were lost
SPIKE = 1.5                           # a sample above both of its neighbours times this is none
STANDS = 0.15                         # share of its greatest speed below which a wheel is not at work
AFTER_FEED_S = 1.0                    # a ball reaches the wheels so long after the feeder starts
LATE_S = 0.25                         # and passes so long after the feeder stops
NOISE = 6.0                           # standard deviations: a smaller fall is noise
CLEAR = 0.5                           # share of that which a step has at least where a fall has begun


@dataclass(frozen=True)
class FoundShots:
    """Detected shots. t_s [n]: just before each ball touches the wheels, or when the feeder starts; and other
    observations."""

    t_s: Floats
    odd: tuple[str, ...]


def find_shots(wheel: Series, set_point: Series | None, feed: Series | None, feed_above: float,
               least_dip: float) -> FoundShots:
    """Return the shots of one log.

    Without a feeder signal every dip is a shot; with one, every dip while it feeds. Feeding without a dip, and a dip
    without feeding, are listed as odd.
    """
    dips = find_dips(wheel, set_point, least_dip)
    if feed is None:
        return FoundShots(dips, ())
    starts, ends = _runs(feed, feed_above)
    odd, times = [], list[float]()
    taken = np.zeros(len(dips), dtype=bool)
    for start, end in zip(starts, ends, strict=True):
        mine = ~taken & (dips >= start) & (dips <= max(end + LATE_S, start + AFTER_FEED_S))
        taken |= mine
        if not mine.any():
            odd.append(f"t = {start:.2f} s: fed, but the wheels do not slow down: no ball?")
        # the first ball of a run passes after the feeder has started; of what it was before, nothing has changed yet
        times += [start, *dips[mine][1:]] if mine.any() else []
    odd += [f"t = {t_s:.2f} s: the wheels slow down as by a ball, but nothing is fed" for t_s in dips[~taken]]
    return FoundShots(np.array(sorted(times)), tuple(odd))


def _runs(feed: Series, above: float) -> tuple[Floats, Floats]:
    """(starts, ends) of the times at which a signal is above a value."""
    on = np.concatenate([[False], np.asarray(feed.values, dtype=float) > above])
    starts = np.flatnonzero(on[1:] & ~on[:-1])
    ends = np.flatnonzero(~on[1:] & on[:-1])
    last = feed.t_s[-1] if len(feed.t_s) else 0.0
    return feed.t_s[starts], np.concatenate([feed.t_s[ends], np.full(len(starts) - len(ends), last)])


def silences(wheel: Series, others: Iterable[Series]) -> tuple[str, ...]:
    """Return lines on where a wheel that runs before or after has no reading for longer than a dip lasts, nor do other
    signals; and where the log ends while it runs."""
    if len(wheel.t_s) < 3:
        return ()
    speed = np.abs(np.asarray(wheel.values, dtype=float))
    works = speed > STANDS * speed.max()
    gaps_s = np.diff(wheel.t_s)
    long = (gaps_s > max(FALL_S, RATES * float(np.median(gaps_s)))) & (works[1:] | works[:-1])
    for series in others if long.any() else ():
        after = np.searchsorted(series.t_s, wheel.t_s[:-1], side="right")
        long &= np.searchsorted(series.t_s, wheel.t_s[1:], side="left") - after <= EDGES
    lines = list[str]()
    if long.any():
        first = int(np.flatnonzero(long)[0])
        lines.append(f"t = {wheel.t_s[first]:.2f} s: nothing was logged for {gaps_s[first]:.2f} s while the wheels turn"
                     + (f"; {np.count_nonzero(long)} times in all" if np.count_nonzero(long) > 1 else "")
                     + "; shots there may be missing")
    if works[-1]:
        lines.append(f"ends at t = {wheel.t_s[-1]:.2f} s while the wheels turn; if it was cut short, shots after that "
                     "are missing")
    return tuple(lines)


def spikes(values: Floats) -> np.ndarray:
    """Return a mask [n] of single samples above both neighbours by half: no wheel does that."""
    speed = np.abs(values)
    beside = np.maximum(np.concatenate([speed[1:], speed[-1:]]), np.concatenate([speed[:1], speed[:-1]]))
    return np.asarray((speed > SPIKE * beside) & (speed > STANDS * speed.max(initial=0.0)))


def find_dips(wheel: Series, set_point: Series | None, least_dip: float) -> Floats:
    """Return times [n] of the last sample before each dip: a fast fall of the speed, below the set point if there is
    one, otherwise followed by a rise."""
    t_s, speed = wheel.t_s, np.abs(np.asarray(wheel.values, dtype=float))
    if len(t_s) < 3:
        return np.zeros(0)
    wanted = np.full(len(t_s), np.inf) if set_point is None else np.abs(_at(set_point, t_s))
    noise, works = NOISE * _noise(speed), STANDS * speed.max()
    found, highs, low, top = list[float](), deque[int](), -1, 0.0
    for k in range(len(speed)):
        if low >= 0:                  # in a dip
            low = k if speed[k] < speed[low] else low
            if speed[k] - speed[low] < REGAINED * (top - speed[low]) and t_s[k] - t_s[low] < RECOVER_S:
                continue
            low = -1
            highs.clear()
        _keep_highest(highs, t_s, speed, k)
        high = highs[0]
        top = min(speed[high], wanted[k])
        if top - speed[k] > max(noise, least_dip * speed[high]) and speed[high] > works:
            low = k
            if set_point is not None or _rises(t_s, speed, high, k):
                found.append(float(t_s[_brink(speed, high, k, noise)]))
    return np.array(found)


def _keep_highest(highs: deque[int], t_s: Floats, speed: Floats, k: int) -> None:
    """Add a sample to the places of a sliding maximum over FALL_S, the highest first."""
    while highs and t_s[highs[0]] < t_s[k] - FALL_S:
        highs.popleft()
    while highs and speed[highs[-1]] <= speed[k]:
        highs.pop()
    highs.append(k)


def _brink(speed: Floats, high: int, k: int, noise: float) -> int:
    """The last sample before the steep part of the fall from high to k."""
    steps = -np.diff(speed[high:k + 1])
    steep = int(np.argmax(steps))
    while steep > 0 and steps[steep - 1] > max(STEEP * steps.max(), CLEAR * noise):
        steep -= 1
    return high + steep


def _rises(t_s: Floats, speed: Floats, high: int, k: int) -> bool:
    """Whether the speed comes back soon after a fall: it was not let go."""
    after = speed[k:int(np.searchsorted(t_s, t_s[k] + RECOVER_S))]
    lowest = np.minimum.accumulate(after)
    return bool((after - lowest > REGAINED * (speed[high] - lowest)).any())


def _noise(speed: Floats) -> float:
    """Standard deviation of what differs between neighbours, robustly: most samples have no ball near."""
    steps = np.diff(speed[speed > STANDS * speed.max()])
    steps = steps[steps != 0.0]
    return 0.0 if len(steps) < 3 else float(1.4826 * np.median(np.abs(steps)) / np.sqrt(2.0))


def _at(series: Series, t_s: Floats) -> Floats:
    """The newest value at each time, 0 where there is none yet."""
    place = np.searchsorted(series.t_s, t_s, side="right") - 1
    return np.where(place < 0, 0.0, np.asarray(series.values, dtype=float)[np.maximum(place, 0)])


PULSE_S = 0.2, 2.0                    # a fall sooner after a shot is none of its outcome's; a pulse is shorter
FALLS = 2                             # of a state, at least


def state_or_pulse(scored: Series, shots_s: Floats) -> tuple[dict[str, str], str]:
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
