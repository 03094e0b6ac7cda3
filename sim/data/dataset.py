"""A dataset in memory: columns, SI, one row a shot."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import repeat
from typing import Any, Self, TypeVar

import numpy as np
import numpy.typing as npt

from truearc.robot.config.rig_spec import Rig
from truearc.sim.printed import Printed, left_out_lines

Floats = npt.NDArray[np.float64]
Table = TypeVar("Table", bound="ShotSamples")


@dataclass(frozen=True)
class Shots:
    """Shots in columns. `numbers`: float64 [n], nan = missing. `texts`: one string a shot, "" = missing.

    `source`: the file they were read from, for messages about them; `written`: column -> its name there, if another.
    """

    shot_id: tuple[str, ...]
    numbers: dict[str, Floats]
    texts: dict[str, tuple[str, ...]]
    source: str = "shots"
    written: dict[str, str] = field(default_factory=dict)

    @classmethod
    def of_settings(cls, distance_m: Floats, hood_deg: Floats, motor_ratio: Floats) -> "Shots":
        """Shots of configurations [n] alone, numbered from 0."""
        return cls(tuple(map(str, range(len(distance_m)))),
                   {"distance_m": distance_m, "hood_deg": hood_deg, "motor_ratio": motor_ratio}, {})

    def __len__(self) -> int:
        return len(self.shot_id)

    @property
    def timed(self) -> bool:
        """Whether every shot has a time, and not all the same; otherwise the order of the shots is unknown."""
        t_s = self.number("t_s")
        return len(t_s) > 0 and bool(np.isfinite(t_s).all() and np.ptp(t_s) > 0.0)

    def number(self, name: str) -> Floats:
        """A numeric column; all nan when the dataset has none of that name."""
        return self.numbers[name] if name in self.numbers else np.full(len(self), np.nan)

    def text(self, name: str) -> tuple[str, ...]:
        """A text column; all "" when the dataset has none of that name."""
        return self.texts[name] if name in self.texts else ("",) * len(self)

    def take(self, index: Any) -> "Shots":
        """The shots at integer positions or under a boolean mask, in that order."""
        rows = np.arange(len(self))[np.asarray(index)]
        return Shots(tuple(self.shot_id[row] for row in rows),
                     {name: column[rows] for name, column in self.numbers.items()},
                     {name: tuple(column[row] for row in rows) for name, column in self.texts.items()}, self.source,
                     self.written)


@dataclass(frozen=True)
class ShotSamples:
    """Measurements made through shots. `shot`: row in Shots; all columns [m]."""

    shot: npt.NDArray[np.int64]
    t_s: Floats

    def by_shot(self) -> list[tuple[int, npt.NDArray[np.int64]]]:
        """(shot, its rows in their order) of each shot that has samples, ascending."""
        order = np.argsort(self.shot, kind="stable")
        shots, starts = np.unique(self.shot[order], return_index=True)
        return list(zip(shots.tolist(), np.split(order, starts[1:]), strict=True))

    def moved(self, place: npt.NDArray[np.int64]) -> Self:
        """The samples by shot, of shots that have a place (0 or more), which is their new row."""
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
class Times(ShotSamples):
    """When the ball came by a height, in s after its release, with the standard deviation of that time."""

    height_m: Floats
    sigma_s: Floats


@dataclass(frozen=True)
class Traces(ShotSamples):
    """Telemetry through shots; `t_s` = 0 when the ball is fed."""

    signal: tuple[str, ...]
    value: Floats

    @classmethod
    def of(cls, rows: Sequence[tuple[int, float, str, float]]) -> "Traces | None":
        """Traces of samples (shot, t_s, signal, value); None of no sample."""
        if not rows:
            return None
        shot, t_s, signal, value = zip(*rows, strict=True)
        return cls(np.array(shot, dtype=np.int64), np.array(t_s), tuple(signal), np.array(value))


@dataclass(frozen=True)
class Dataset(Printed):
    """All that a directory of shots says; `left_out`: what its maker left out and why, one line each.

    `accepted`: objections to its plausibility that the user accepted or that only warn. `track_columns`: as
    Shots.written, of the tracks.
    """

    name: str
    facts: Rig
    shots: Shots
    tracks: Tracks | None = None
    traces: Traces | None = None
    left_out: tuple[str, ...] = ()
    accepted: tuple[str, ...] = ()
    track_columns: dict[str, str] = field(default_factory=dict)
    times: Times | None = None

    @property
    def samples(self) -> dict[str, "Tracks | Traces | Times"]:
        """The tables of measurements through shots that there are, by name."""
        tables = {"tracks": self.tracks, "traces": self.traces, "times": self.times}
        return {name: table for name, table in tables.items() if table is not None}

    @property
    def rig(self) -> Rig:
        """The rig that the shots were made with."""
        return self.facts

    def in_order(self) -> "Dataset":
        """Return the dataset with its shots by session and time; where a time is missing, by all that is known of each.

        So what is drawn at random from the shots, and which of them are held out, is the same for every order of rows.
        """
        rows = sorted(range(len(self.shots)), key=self._keys().__getitem__)
        return self if rows == list(range(len(rows))) else self.take(rows)

    def take(self, rows: Sequence[int]) -> "Dataset":
        """The shots at these rows, in that order, with their measurements."""
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
        """Return how many shots, outcomes and samples there are, which columns, and what was left out."""
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


def _counted(name: str) -> list[tuple[int, str]]:
    """A name to sort by, its numbers as such: day9 before day10."""
    return [(int(part) if part.isdecimal() else -1, part) for part in re.split(r"(\d+)", name)]


def _samples(table: ShotSamples, count: int) -> list[tuple[Any, ...]]:
    """The samples of each of `count` shots, to tell shots apart of which all else is alike."""
    found: list[list[Any]] = [[] for _ in range(count)]
    for shot, *sample in zip(*vars(table).values(), strict=True):
        found[shot].append(tuple(sample))
    return [tuple(one) for one in found]


def join_datasets(first: Dataset, second: Dataset) -> Dataset:
    """The shots of both, the first's before the second's; name, rig and what was left out are the first's.

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
