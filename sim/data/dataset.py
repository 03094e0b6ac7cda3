"""A dataset in memory: columns in SI units with one row per shot, and the conditions of the shots."""

import re
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby, repeat
from typing import Any, NamedTuple, Self, TypeVar

import msgspec
import numpy as np
import numpy.typing as npt

from truearc.robot.config.rig_spec import Rig
from truearc.sim.printed import Printed, left_out_lines

Floats = npt.NDArray[np.float64]
Written = tuple[str, float, float]    # name in the file, how many of a column's unit are one of the file's, its zero
Table = TypeVar("Table", bound="ShotSamples")


@dataclass(frozen=True)
class Shots:
    """Shots in columns. `numbers`: float64 [n], nan = missing. `texts`: one string per shot, "" = missing.

    `source`: the file they were read from, for messages; `written`: of columns that are called otherwise there.
    """

    shot_id: tuple[str, ...]
    numbers: dict[str, Floats]
    texts: dict[str, tuple[str, ...]]
    source: str = "shots"
    written: dict[str, Written] = field(default_factory=dict)

    @classmethod
    def of_settings(cls, distance_m: Floats, hood_deg: Floats, motor_ratio: Floats) -> "Shots":
        """Return shots of configurations [n] alone, numbered from 0."""
        return cls(tuple(map(str, range(len(distance_m)))),
                   {"distance_m": distance_m, "hood_deg": hood_deg, "motor_ratio": motor_ratio}, {})

    def __len__(self) -> int:
        return len(self.shot_id)

    @property
    def timed(self) -> bool:
        """Whether every shot has a time, and the times differ; otherwise the order of the shots is unknown."""
        t_s = self.number("t_s")
        return len(t_s) > 0 and bool(np.isfinite(t_s).all() and np.ptp(t_s) > 0.0)

    def number(self, name: str) -> Floats:
        """Return a numeric column; all nan if the dataset has none of that name."""
        return self.numbers[name] if name in self.numbers else np.full(len(self), np.nan)

    def text(self, name: str) -> tuple[str, ...]:
        """Return a text column; all "" if the dataset has none of that name."""
        return self.texts[name] if name in self.texts else ("",) * len(self)

    def take(self, index: Any) -> "Shots":
        """Return the shots at integer positions or under a boolean mask, in that order."""
        rows = np.arange(len(self))[np.asarray(index)]
        return Shots(tuple(self.shot_id[row] for row in rows),
                     {name: column[rows] for name, column in self.numbers.items()},
                     {name: tuple(column[row] for row in rows) for name, column in self.texts.items()}, self.source,
                     self.written)


@dataclass(frozen=True)
class ShotSamples:
    """Measurements made during shots. `shot`: row in Shots; all columns [m]."""

    shot: npt.NDArray[np.int64]
    t_s: Floats

    def by_shot(self) -> list[tuple[int, npt.NDArray[np.int64]]]:
        """Yield (shot, its rows in order) of each shot that has samples, ascending."""
        order = np.argsort(self.shot, kind="stable")
        shots, starts = np.unique(self.shot[order], return_index=True)
        return list(zip(shots.tolist(), np.split(order, starts[1:]), strict=True)) if len(order) else []

    def moved(self, place: npt.NDArray[np.int64]) -> Self:
        """Return the samples by shot for shots with a place (0 or more), which is their new row."""
        kept = np.flatnonzero(place[self.shot] >= 0)
        rows = kept[np.argsort(place[self.shot[kept]], kind="stable")]
        columns: dict[str, Any] = {name: tuple(column[row] for row in rows) if isinstance(column, tuple) else
                                   column[rows] for name, column in vars(self).items()}
        return replace(self, **{**columns, "shot": place[columns["shot"]]})


@dataclass(frozen=True)
class Tracks(ShotSamples):
    """Measured ball positions, launcher frame."""

    x_m: Floats
    y_m: Floats
    z_m: Floats


@dataclass(frozen=True)
class NoisyTracks(Tracks):
    """Tracks whose samples are not equally accurate: standard deviations across and up. Only their ratios count."""

    sigma_x_m: Floats
    sigma_z_m: Floats


@dataclass(frozen=True)
class Times(ShotSamples):
    """When the ball passed a height, in s after its release, with the standard deviation of that time."""

    height_m: Floats
    sigma_s: Floats


@dataclass(frozen=True)
class Traces(ShotSamples):
    """Telemetry during shots; `t_s` = 0 when the ball is fed."""

    signal: tuple[str, ...]
    value: Floats

    @classmethod
    def of(cls, rows: Sequence[tuple[int, float, str, float]]) -> "Traces | None":
        """Return traces of samples (shot, t_s, signal, value); None if there are none."""
        if not rows:
            return None
        shot, t_s, signal, value = zip(*rows, strict=True)
        return cls(np.array(shot, dtype=np.int64), np.array(t_s), tuple(signal), np.array(value))


class Film(msgspec.Struct, frozen=True):
    """What a camera beside the flights had in view, for pictures only.

    picture: A coded picture (JPEG).
    to_pixel: A shot's matrix [3, 2] from (metres ahead of the exit, above the floor, 1) to a pixel of it.
    """

    picture: bytes
    to_pixel: dict[str, tuple[tuple[float, float], tuple[float, float], tuple[float, float]]]


@dataclass(frozen=True)
class Dataset(Printed):
    """Contents of a directory of shots. `left_out`: excluded data with the reason, one line each.

    `accepted`: plausibility objections that the user accepted or that only warn. `track_columns`: like Shots.written,
    for the tracks. `imported`: the command that made it of a team's file, "" for none. `film`: of tracks from clips.
    """

    name: str
    facts: Rig
    shots: Shots
    tracks: Tracks | None = None
    traces: Traces | None = None
    left_out: tuple[str, ...] = ()
    accepted: tuple[str, ...] = ()
    track_columns: dict[str, Written] = field(default_factory=dict)
    times: Times | None = None
    imported: str = ""
    film: Film | None = None

    @property
    def samples(self) -> dict[str, "Tracks | Traces | Times"]:
        """The existing tables of measurements during shots, by name."""
        tables = {"tracks": self.tracks, "traces": self.traces, "times": self.times}
        return {name: table for name, table in tables.items() if table is not None}

    @property
    def rig(self) -> Rig:
        """The rig that made the shots."""
        return self.facts

    def in_order(self) -> "Dataset":
        """Return the dataset with its shots ordered by session and time, or by all their data if a time is missing.

        Random draws from the shots and the hold-out set are thus the same for every order of rows.
        """
        rows = sorted(range(len(self.shots)), key=self._keys().__getitem__)
        return self if rows == list(range(len(rows))) else self.take(rows)

    def take(self, rows: Sequence[int]) -> "Dataset":
        """Return the shots at these rows, in that order, with their measurements."""
        place = np.full(len(self.shots), -1)
        place[list(rows)] = np.arange(len(rows))
        samples: dict[str, Any] = {name: table.moved(place) for name, table in self.samples.items()}
        return replace(self, shots=self.shots.take(list(rows)), **samples)

    def _keys(self) -> list[tuple[Any, ...]]:
        """What each shot is sorted by: session and time first, if all times are known; its name last."""
        shots = self.shots
        numbers = [np.nan_to_num(shots.numbers[name], nan=np.inf).tolist() for name in sorted(shots.numbers)]
        texts = [shots.texts[name] for name in sorted(shots.texts)]
        known = [tuple(column[row] for column in (*numbers, *texts)) for row in range(len(shots))]
        sessions = map(_counted, shots.text("session"))
        when = zip(sessions, shots.number("t_s").tolist(), strict=True) if shots.timed else repeat(())
        samples = list(zip(*(_samples(table, len(shots)) for table in self.samples.values()), strict=True))
        return list(zip(when, known, samples or repeat(()), shots.shot_id, strict=False))

    def lines(self) -> list[str]:
        """Return the numbers of shots, outcomes and samples, the columns, and the excluded data."""
        outcomes = self.shots.text("outcome")
        if self.rig.target is not None:
            outcomes = tuple(map(self.rig.target.word, outcomes))
        counts = {kind or "unmarked": outcomes.count(kind) for kind in dict.fromkeys(outcomes)}
        marked = set(counts) != {"unmarked"} or not self.samples       # flights need no outcomes
        kinds = f" ({', '.join(f'{count} {kind}' for kind, count in counts.items())})" if marked else ""
        lines = [f"{self.name}: {len(self.shots)} shots{kinds}",
                 f"columns: {', '.join(['shot_id', *self.shots.numbers, *self.shots.texts])}"]
        sides = [side for side in self.shots.text("side") if side]
        counted = ", ".join(f"{sides.count(side)} {side}" for side in dict.fromkeys(sides))
        lines += [f"sides: {counted}"] if sides else []
        lines += [f"{name}: {len(table.t_s)} samples" for name, table in self.samples.items()]
        return lines + left_out_lines(self.left_out)

    def notes(self) -> tuple[str, ...]:
        """Return a line for each thing that limits what the shots can show, or that is seldom true of real ones.

        These are rows that repeat another, shots of one instant, empty cells, outcomes of one kind, scores from wheels
        that stand, a voltage that never changes, and balls that left below the straight line to the opening's lower
        rim. No command refuses them.
        """
        return (*_repeated(self), *_empty(self), *_one_kind(self), *_standing(self.shots), *_still(self.shots),
                *_flat(self))


def _counted(name: str) -> tuple[tuple[int, str], ...]:
    """A name to sort by, its numbers as such: day9 before day10."""
    return tuple((int(part) if part.isdecimal() else -1, part) for part in re.split(r"(\d+)", name))


def _samples(table: ShotSamples, count: int) -> list[tuple[Any, ...]]:
    """The samples of each of `count` shots, to tell shots apart of which all else is alike."""
    found: list[list[Any]] = [[] for _ in range(count)]
    for shot, *sample in zip(*vars(table).values(), strict=True):
        found[shot].append(tuple(sample))
    return [tuple(one) for one in found]


# Chosen: copies are few or a block; in a table of settings and outcomes alone, repeated shots look like copies
FEW_COPIES = 0.2                      # share of rows without times, from which equal ones are repeated shots
BLOCK = 3                             # different rows after each other that are there again are copies
MANY_SHOTS = 10                       # from which a voltage of one value is no chance; chosen: a voltmeter's steps
MOST_EMPTY = 8                        # columns that a line names; chosen: a printed line
LOST = {"distance_m": "where these shots passed the target is not used",
        "hood_deg": "without exit_deg these shots are not used", "t_s": "so the order of the shots is not used at all",
        "motor_ratio": "without wheel speeds or exit_speed_m_s these shots are not used"}


def _repeated(dataset: Dataset) -> Iterator[str]:
    """Rows that are the same as an earlier one but for their name; and other shots of one session's instant."""
    shots, ids = dataset.shots, dataset.shots.shot_id
    numbered = len(ids) > 1 and np.median(np.diff(shots.number("t_s"))) == 1.0        # the order of rows is no time
    plain = replace(dataset, shots=replace(shots, numbers={name: column for name, column in shots.numbers.items()
                                                           if name != "t_s" or not numbered}))
    keys = [key[:-1] for key in plain._keys()]
    copies = _again(keys)
    if not plain.shots.timed and len(copies) > FEW_COPIES * len(ids):
        copies = _blocks(keys, copies)
    if copies:
        yield (f"rows that repeat an earlier one but for the name: {_listed(ids, copies)}; a shot that is written "
               "twice counts twice")
    t_s, copied = shots.number("t_s"), {row for row, _ in copies}
    instants = [(session, at if np.isfinite(at) else f"row {row}")
                for row, (session, at) in enumerate(zip(shots.text("session"), t_s.tolist(), strict=True))]
    same = [pair for pair in _again(instants) if pair[0] not in copied]
    if same and len(np.unique(t_s[np.isfinite(t_s)])) > 1:            # else no times
        yield (f"t_s: shots at the same instant as an earlier one: {_listed(ids, same)}; was one written twice? If "
               "they are of two sessions, name these in the column session")


def _again(keys: Sequence[Hashable]) -> list[tuple[int, int]]:
    """(place, place of the first that equals it) of each key that was there before."""
    first: dict[Hashable, int] = {}
    return [(row, first[key]) for row, key in enumerate(keys) if first.setdefault(key, row) != row]


def _blocks(keys: Sequence[Hashable], pairs: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Those of the pairs that are part of a block of different rows, which repeats an earlier one."""
    runs = groupby(enumerate(pairs), lambda one: (one[1][0] - one[0], one[1][0] - one[1][1]))
    blocks = [[pair for _, pair in run] for _, run in runs]
    return [pair for block in blocks if len({keys[row] for row, _ in block}) >= BLOCK for pair in block]


def _listed(ids: tuple[str, ...], pairs: Sequence[tuple[int, int]]) -> str:
    first = ", ".join(f"{ids[row]} as {ids[before]}" for row, before in pairs[:3])
    return f"{len(pairs)} ({first}{', ...' if len(pairs) > 3 else ''})"


def _empty(dataset: Dataset) -> Iterator[str]:
    """Columns with some cells empty, by count; those whose place another column takes do not lack them."""
    shots, others = dataset.shots, []
    wheels = [name for name in shots.numbers if name.startswith(WHEEL)]
    instead = {"hood_deg": ["exit_deg"], "motor_ratio": ["exit_speed_m_s", *wheels]}
    for name in shots.numbers:
        cells = [shots.number(one) for one in (name, *instead.get(name, ()))]
        count = int(np.isnan(cells).all(axis=0).sum())
        if 0 < count < len(shots) and name in LOST:
            yield f"{name}: {count} of {len(shots)} empty: {LOST[name]}"
        elif 0 < count < len(shots) and name not in ("since_last_shot_s", "miss_height_m"):       # often none
            others.append(f"{name} {count}")
    if others:
        more = f" and {len(others) - MOST_EMPTY} more" if len(others) > MOST_EMPTY else ""
        yield (f"cells empty of {len(shots)}: {', '.join(others[:MOST_EMPTY])}{more}: these shots tell nothing of what "
               "goes with that column")
    seen = np.isfinite(shots.number("miss_height_m")) | (np.array(shots.text("outcome")) != "")
    for table in dataset.samples.values():
        seen[table.shot] = True
    if 0 < (count := int((~seen).sum())) < len(shots):
        yield f"outcome: {count} of {len(shots)} empty: nothing is known of where these shots went"


def _one_kind(dataset: Dataset) -> Iterator[str]:
    """Outcomes that are all alike where nothing else was seen of the flights."""
    shots = dataset.shots
    kinds = {word != "miss" for word in shots.text("outcome") if word}
    if len(kinds) == 1 and not (any(shots.text("side")) or {"tracks", "times"} & set(dataset.samples)
                                or np.isfinite(shots.number("miss_height_m")).any()):
        only, other = ("makes", "misses") if True in kinds else ("misses", "makes")
        yield f"only {only}: nothing can be learnt about {other}; shots of both kinds tell most"


def _standing(shots: Shots) -> Iterator[str]:
    """Shots that scored although all speeds that are known of them are 0."""
    speeds = np.array([column for name, column in shots.numbers.items()
                       if name in ("motor_ratio", "exit_speed_m_s") or name.startswith(WHEEL)] or [shots.number("")])
    still = (np.nan_to_num(speeds) == 0.0).all(axis=0) & np.isfinite(speeds).any(axis=0)
    scored = [name for name, at_0, outcome in zip(shots.shot_id, still, shots.text("outcome"), strict=True)
              if at_0 and outcome not in ("", "miss")]
    if scored:
        yield (f"speed 0 in {len(scored)} of {len(shots)} shots, which scored ({', '.join(scored[:3])}"
               f"{', ...' if scored[3:] else ''}): nothing flies from wheels that stand; correct these cells, or leave "
               "them empty")


def _still(shots: Shots) -> Iterator[str]:
    voltage = shots.number("battery_v")[np.isfinite(shots.number("battery_v"))]
    if len(voltage) >= MANY_SHOTS and np.ptp(voltage) == 0.0:
        yield (f"battery_v: the voltage never changes ({voltage[0]:g} V in {len(voltage)} shots): that of a robot "
               "does; were these shots simulated?")


def _flat(dataset: Dataset) -> Iterator[str]:
    """Balls that are said to have passed the opening's plane at a known height, but left below the straight line to
    its lower rim: a ball falls below the line that it leaves along."""
    target, shots = dataset.facts.target, dataset.shots
    if target is None:
        return
    distance_m, hood_deg = shots.number("distance_m"), shots.number("hood_deg")
    rim_m = target.centre_height_m + shots.number("miss_height_m") - target.two_half_height_m
    needed_deg = np.degrees(np.arctan2(rim_m - dataset.facts.launcher.release_height_m, distance_m))
    lacking_deg = needed_deg - hood_deg
    flat = np.flatnonzero(lacking_deg > 0.0)
    if len(flat):
        worst = flat[np.argmax(lacking_deg[flat])]
        yield (f"{len(flat)} of {len(shots)} shots leave flatter than a straight line to the opening's lower rim, so "
               f"that no ball without more lift than weight gets there: {shots.shot_id[worst]} at "
               f"{distance_m[worst]:.2f} m has {hood_deg[worst]:.1f} deg, where {needed_deg[worst]:.1f} are the least. "
               "Their hood_deg may be no elevation, or have another zero; what discover names may then only stand for "
               "that")


def join_datasets(first: Dataset, second: Dataset) -> Dataset:
    """Join two datasets, the first's shots before the second's; name, rig and excluded data are the first's.

    A column that only one of them has is missing in the other's shots. ValueError when a shot_id is in both.
    """
    if set(first.shots.shot_id) & set(second.shots.shot_id):
        raise ValueError("the two datasets have a shot_id in common")
    n = len(first.shots)
    samples: dict[str, Any] = {name: _join(first.samples.get(name), second.samples.get(name), n)
                               for name in dict.fromkeys([*first.samples, *second.samples])}
    return replace(first, shots=_join_shots(first.shots, second.shots), **samples)


def _join_shots(first: Shots, second: Shots) -> Shots:
    numbers = {name: np.concatenate([first.number(name), second.number(name)])
               for name in dict.fromkeys([*first.numbers, *second.numbers])}
    texts = {name: first.text(name) + second.text(name) for name in dict.fromkeys([*first.texts, *second.texts])}
    return Shots(first.shot_id + second.shot_id, numbers, texts, first.source)


def _join(first: Table | None, second: Table | None, n: int) -> Table | None:
    """The samples of both; n: shots before those of the second."""
    if first is None or second is None:
        return first if second is None else replace(second, shot=second.shot + n)
    later = vars(replace(second, shot=second.shot + n))
    columns: dict[str, Any] = {name: column + later[name] if isinstance(column, tuple) else
                               np.concatenate([column, later[name]]) for name, column in vars(first).items()}
    return replace(first, **columns)


KELVIN = 273.15                       # at 0 deg C
WHEEL, SPEED = "wheel_", "_rad_s"     # a trace of a wheel's speed is called wheel_<name>_rad_s
BEFORE_S = 0.02                       # how long before the ball is fed a wheel's speed still counts as what it was
LEAST_CHANGE_DEG = 1e-6               # of the hood; less does not count as a move


class Circumstances(NamedTuple):
    """Conditions that a term may depend on: arrays [n], or numbers; by default those of an ordinary shot.

    circumstances_of gathers them from a dataset.
    """

    battery: Any = 0.0                # (battery_v - median) / median
    since_last_shot_s: Any = 1e9      # unknown, or the first of its session: long ago
    age: Any = 0.0                    # 0 to 1: how far through its session, or with ball_id through that ball's shots
    droop: Any = 1.0                  # dip of the wheels while the ball passes, by traces, / its mean; 1 without traces
    density: Any = 0.0                # of the air, / its median, - 1
    hood_change: Any = 0.0            # sign of this hood_deg less that of the session's shot before
    closing_speed_m_s: Any = 0.0      # of the robot, toward the target positive
    ball: Any = 0.0                   # a ball's own departure in units of the balls' spread; unknown: 0
    free_speed: Any = 0.0             # sizes of unexplained effects, by truearc.sim.infer.belief,
    free_elevation: Any = 0.0
    free_distance: Any = 0.0
    free_push: Any = 0.0
    curve_by: Any = 0.0               # and their derivatives by their curves' points, one curve after another [n, K]


# What has to be recorded of shots for a circumstance to be known.
RECORDED = {
    "battery": "battery_v of each shot",
    "age": "ball_id or t_s of each shot",
    "droop": "wheel speeds through the shot (traces.csv)",
    "density": "temperature_c and pressure_pa",
    "hood_change": "hood_deg of shots in their order",
    "closing_speed_m_s": "robot_speed_m_s of each shot",
    "ball": "ball_id of each shot",
}
ORDINARY = Circumstances()


class Known(NamedTuple):
    """One circumstance [n], and for which shots the data contain it."""

    value: np.ndarray
    said: np.ndarray


def circumstances_of(dataset: Dataset) -> Circumstances:
    """Return the circumstances of every shot of a dataset, arrays [n]; ordinary ones where the data lack them.

    battery, density: against the median of the shots that have it. since_last_shot_s: its own column, else differences
    of t_s within the session; the first shot of a session was long after another. age: with ball_id the shots that the
    ball has had by the most that any ball has had, else how far through its session by t_s.
    droop: largest dip of the wheels from their speed as the ball is fed, in shares of it, mean of the wheels, by the
    mean over shots. hood_change: since the session's shot before. Where a shot has no t_s, age and hood_change are
    unknown: the order of rows is none.
    """
    found = gather_circumstances(dataset)
    return Circumstances(**{name: np.where(known.said, known.value, getattr(ORDINARY, name))
                            for name, known in found.items()}, ball=np.zeros(len(dataset.shots)))


def gather_circumstances(dataset: Dataset) -> dict[str, Known]:
    """Return {field of Circumstances: its values, and for which shots the data contain it}."""
    shots = dataset.shots
    found = {"battery": _departure(shots.number("battery_v")), "since_last_shot_s": _since(shots), "age": _age(shots),
             "droop": _droop(dataset.traces, len(shots)), "density": _density(shots),
             "hood_change": _hood_change(shots), "closing_speed_m_s": shots.number("robot_speed_m_s")}
    return {name: Known(np.nan_to_num(column, posinf=0.0, neginf=0.0), np.isfinite(column))
            for name, column in found.items()}


def _departure(column: np.ndarray) -> np.ndarray:
    """From the median, in shares of it; here and below NaN where unknown."""
    said = np.isfinite(column)
    median = np.median(column[said]) if said.any() else 0.0
    return column / median - 1.0 if median != 0.0 else np.full(len(column), np.nan)


def _density(shots: Shots) -> np.ndarray:
    """By the ideal gas: pressure / temperature, a missing one of the two taken as its median, or as steady."""
    pressure, kelvin = shots.number("pressure_pa"), shots.number("temperature_c") + KELVIN
    said = np.isfinite(pressure) | np.isfinite(kelvin)
    return _departure(np.where(said, _filled(pressure) / _filled(kelvin), np.nan))


def _filled(column: np.ndarray) -> np.ndarray:
    missing = ~np.isfinite(column)
    return np.where(missing, 1.0 if missing.all() else np.median(column[~missing]), column)


def _sessions(shots: Shots) -> Iterator[np.ndarray]:
    """Rows of each session in the order in which they were shot; none where a shot has no time."""
    names, t_s = np.array(shots.text("session")), shots.number("t_s")
    for name in dict.fromkeys(names) if shots.timed else ():
        rows = np.flatnonzero(names == name)
        yield rows[np.argsort(t_s[rows], kind="stable")]


def _since(shots: Shots) -> np.ndarray:
    value, t_s = shots.number("since_last_shot_s").copy(), shots.number("t_s")
    for rows in _sessions(shots):
        gaps = np.diff(t_s[rows])
        later = rows[1:]
        value[later] = np.where(np.isnan(value[later]), gaps, value[later])
    return np.where(value >= 0.0, value, np.nan)


def counts_shots(shots: Shots) -> bool:
    """Return whether `age` counts the shots of each ball: all balls are known, and when each was shot."""
    return shots.timed and all(shots.text("ball_id"))


def _age(shots: Shots) -> np.ndarray:
    if counts_shots(shots):
        return _shots_had(shots, np.array(shots.text("ball_id")))
    value = np.full(len(shots), np.nan)
    for rows in _sessions(shots):
        t_s = shots.number("t_s")[rows]
        value[rows] = (t_s - t_s[0]) / (t_s[-1] - t_s[0]) if t_s[-1] > t_s[0] else np.nan
    return value


def _shots_had(shots: Shots, balls: np.ndarray) -> np.ndarray:
    """How often each shot's ball has been shot before, by the most that any has been."""
    had, count = np.zeros(len(balls)), dict.fromkeys(np.unique(balls), 0)
    for rows in _sessions(shots):
        for row in rows:
            had[row] = count[balls[row]]
            count[balls[row]] += 1
    return np.asarray(had / max(had.max(), 1.0))


def _droop(traces: Traces | None, count: int) -> np.ndarray:
    unknown = np.full(count, np.nan)
    if traces is None:
        return unknown
    signals = np.array(traces.signal)
    wheels = [name for name in np.unique(signals) if name.startswith(WHEEL) and name.endswith(SPEED)]
    dips = [unknown, *(_dips(traces, signals == name, count) for name in wheels)]
    heard = np.isfinite(dips)
    dip = np.where(heard, dips, 0.0).sum(0) / np.maximum(heard.sum(0), 1)
    said = np.any(heard, axis=0)
    mean = dip[said].mean() if said.any() else 0.0
    return np.where(said, dip / mean, np.nan) if mean > 0.0 else unknown


def _dips(traces: Traces, here: np.ndarray, count: int) -> np.ndarray:
    """Largest dip [count] of a signal after the ball is fed, in shares of what it was; nan where unknown."""
    dip = np.full(count, np.nan)
    rows = np.flatnonzero(here)
    rows = rows[np.lexsort((traces.t_s[rows], traces.shot[rows]))]
    shots, first = np.unique(traces.shot[rows], return_index=True)
    for shot, mine in zip(shots, np.split(rows, first[1:]), strict=True):
        t_s, value = traces.t_s[mine], traces.value[mine]
        before, after = (t_s >= -BEFORE_S) & (t_s <= 0.0), t_s >= 0.0
        fed = value[before].mean() if before.any() else value[np.abs(t_s).argmin()]
        if after.sum() > 1 and fed > 0.0:
            dip[shot] = (fed - value[after].min()) / fed
    return dip


def _hood_change(shots: Shots) -> np.ndarray:
    hood_deg, change = shots.number("hood_deg"), np.full(len(shots), np.nan)
    for rows in _sessions(shots):
        moved = np.diff(hood_deg[rows])
        change[rows[1:]] = np.where(np.abs(moved) > LEAST_CHANGE_DEG, np.sign(moved), 0.0)
    return np.where(np.isfinite(hood_deg), change, np.nan)
