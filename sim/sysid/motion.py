"""One law of motion for a motor that turns something: simulated exactly as it is fitted.

    effort = ks(direction) + kv w + kq w |w| + ka dw/dt

with the effort held between its changes and the speed read `delay` late. Within a piece the direction stays, so that
the law is smooth there, and so are its slopes.

The data of a fit: an effort over time and the speeds it caused, cut into pieces of motion in one direction.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from truearc.errors import InputError

Floats = npt.NDArray[np.float64]
MARGIN_S = 0.1                        # the longest delay that is looked for, either way
PIECES = 24                           # about as many are cut, no shorter or longer than these:
SHORTEST_S, LONGEST_S = 0.4, 4.0
MIN_SAMPLES = 8                       # of a piece
MIN_PIECES = 6
LONGEST_STEP_S = 0.025                # of the simulation where the effort does not change
SLOW_SHARE = 0.05                     # below this share of the highest speed the wheel counts as standing


@dataclass(frozen=True)
class Record:
    """Effort held from each `effort_t_s` to the next, and measured speeds; one joint, in the order of time."""

    name: str                         # file or session and joint, for messages
    unit: str                         # of the effort: "nm" or "v"
    effort_t_s: Floats
    effort: Floats
    speed_t_s: Floats
    speed_rad_s: Floats


@dataclass(frozen=True)
class Run:
    """A stretch in which the speed keeps its sign; samples `first` to `last` - 1 of the record, MARGIN_S inside it."""

    direction: float                  # +1 or -1
    first: int
    last: int


def find_runs(record: Record) -> list[Run]:
    """Find the stretches of motion; a joint that stands still gives no information on sliding friction."""
    speed, t_s = record.speed_rad_s, record.speed_t_s
    slow = SLOW_SHARE * float(np.max(np.abs(speed), initial=0.0))
    signs = np.where(speed > slow, 1, np.where(speed < -slow, -1, 0))
    edges = np.flatnonzero(np.diff(signs)) + 1
    runs = []
    for begin, end in pairwise([0, *edges, len(signs)]):
        if end == begin or not signs[begin]:
            continue
        first = int(np.searchsorted(t_s, t_s[begin] + MARGIN_S))
        last = int(np.searchsorted(t_s, t_s[end - 1] - MARGIN_S, side="right"))
        if last - first >= MIN_SAMPLES:
            runs.append(Run(float(signs[begin]), first, last))
    return runs


def cut(record: Record, runs: Sequence[Run]) -> list[Run]:
    """The runs in about PIECES pieces; InputError when that is too little motion for a fit."""
    t_s = record.speed_t_s
    moving_s = sum(t_s[run.last - 1] - t_s[run.first] for run in runs)
    length_s = min(max(moving_s / PIECES, SHORTEST_S), LONGEST_S)
    pieces = []
    for run in runs:
        count = max(1, round((t_s[run.last - 1] - t_s[run.first]) / length_s))
        edges = np.linspace(run.first, run.last, count + 1).astype(int)
        pieces += [Run(run.direction, int(a), int(b)) for a, b in pairwise(edges) if b - a >= MIN_SAMPLES]
    if len(pieces) < MIN_PIECES:
        raise InputError(f"{record.name}: {moving_s:.1f} s of motion in {len(pieces)} pieces; at least {MIN_PIECES} "
                       f"pieces of {SHORTEST_S:g} s are needed")
    return pieces


@dataclass(frozen=True)
class Pieces:
    """Pieces side by side; knots are where the effort changes, and padded at the end by knots of no length."""

    direction: Floats                 # [pieces]
    knot_s: Floats                    # [knots, pieces]
    effort: Floats                    # [knots, pieces], from this knot on
    owner: np.ndarray                 # [samples] piece of each sample
    sample_s: Floats                  # [samples]
    speed_rad_s: Floats               # [samples] as measured
    start_rad_s: Floats               # [pieces] a first guess of the speed at the first knot


def lay_out(record: Record, runs: Sequence[Run]) -> Pieces:
    """The pieces' knots reach MARGIN_S beyond their samples at both ends."""
    knots, efforts = zip(*(_knots(record, run) for run in runs), strict=True)
    longest = max(map(len, knots))
    owner = np.concatenate([np.full(run.last - run.first, piece) for piece, run in enumerate(runs)])
    rows = np.concatenate([np.arange(run.first, run.last) for run in runs])
    return Pieces(
        np.array([run.direction for run in runs]),
        np.stack([np.pad(row, (0, longest - len(row)), mode="edge") for row in knots], axis=1),
        np.stack([np.pad(row, (0, longest - len(row)), mode="edge") for row in efforts], axis=1),
        owner, record.speed_t_s[rows], record.speed_rad_s[rows],
        np.array([_early_speed(record, run) for run in runs]))


def _knots(record: Record, run: Run) -> tuple[Floats, Floats]:
    begin_s = record.speed_t_s[run.first] - MARGIN_S
    end_s = record.speed_t_s[run.last - 1] + MARGIN_S
    changes = np.diff(record.effort, prepend=np.nan) != 0.0
    inside = changes & (record.effort_t_s > begin_s) & (record.effort_t_s < end_s)
    knots = np.concatenate([[begin_s], record.effort_t_s[inside], [end_s]])
    if np.diff(knots).max() > LONGEST_STEP_S:
        knots = np.union1d(knots, np.arange(begin_s, end_s, LONGEST_STEP_S))
    index = np.maximum(np.searchsorted(record.effort_t_s, knots, side="right") - 1, 0)
    return knots, record.effort[index]


def _early_speed(record: Record, run: Run) -> float:
    """The speed MARGIN_S before the first sample, by a line through the piece's first samples."""
    few = slice(run.first, min(run.first + 12, run.last))
    slope, level = np.polyfit(record.speed_t_s[few] - record.speed_t_s[run.first], record.speed_rad_s[few], 1)
    return float(level - slope * MARGIN_S)


@dataclass(frozen=True)
class Law:
    """Which numbers the law has: friction for each direction that occurs, and windage or not."""

    directions: tuple[float, ...]
    windage: bool

    @property
    def names(self) -> tuple[str, ...]:
        frictions = tuple("ks" if direction > 0.0 else "ks_back" for direction in self.directions)
        return (*frictions, "kv", *(("kq",) if self.windage else ()), "ka", "delay_s")

    def unpack(self, values: Floats, direction: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """(signed friction, kv, kq, ka) per set of `values` [..., numbers] and piece: [..., pieces] or [..., 1]."""
        count = len(self.directions)
        which = np.array([self.directions.index(float(one)) for one in direction])
        kq = values[..., count + 1, None] if self.windage else np.zeros_like(values[..., :1])
        return values[..., which] * direction, values[..., count, None], kq, values[..., -2, None]


def simulate(law: Law, values: Floats, start_rad_s: Floats, pieces: Pieces) -> tuple[Floats, Floats, Floats]:
    """Speeds at knots, and accelerations just after and just before each knot's interval ends.

    `values` [sets, numbers], `start_rad_s` [sets, pieces]; returns [knots, sets, pieces] of speed, and
    [knots - 1, sets, pieces] of acceleration at the beginning and at the end of each interval. Runge-Kutta of order 4.
    """
    friction, kv, kq, ka = law.unpack(values, pieces.direction)

    def pull(effort: Floats, speed: Floats) -> Floats:
        return (effort - friction - (kv + kq * np.abs(speed)) * speed) / ka

    speed = start_rad_s
    speeds, begins, ends = [speed], [], []
    for effort, dt in zip(pieces.effort[:-1], np.diff(pieces.knot_s, axis=0), strict=True):
        one = pull(effort, speed)
        two = pull(effort, speed + 0.5 * dt * one)
        three = pull(effort, speed + 0.5 * dt * two)
        four = pull(effort, speed + dt * three)
        speed = speed + dt / 6.0 * (one + 2.0 * two + 2.0 * three + four)
        speeds.append(speed)
        begins.append(one)
        ends.append(pull(effort, speed))
    return np.stack(speeds), np.stack(begins), np.stack(ends)


def expect(law: Law, values: Floats, start_rad_s: Floats, pieces: Pieces) -> Floats:
    """The speeds that the samples should show, [sets, samples]: cubic between knots, read `delay` late."""
    speeds, begins, ends = simulate(law, values, start_rad_s, pieces)
    owner = pieces.owner
    expected = np.empty((len(values), len(owner)))
    for row, delay in enumerate(values[:, -1]):
        at_s = pieces.sample_s - delay
        knot = _interval(pieces, at_s)
        length = pieces.knot_s[knot + 1, owner] - pieces.knot_s[knot, owner]
        share = (at_s - pieces.knot_s[knot, owner]) / length
        left, right = speeds[knot, row, owner], speeds[knot + 1, row, owner]
        rise_left, rise_right = begins[knot, row, owner] * length, ends[knot, row, owner] * length
        expected[row] = (left + share * rise_left
                         + share**2 * (3.0 * (right - left) - 2.0 * rise_left - rise_right)
                         + share**3 * (2.0 * (left - right) + rise_left + rise_right))
    return expected


def _interval(pieces: Pieces, at_s: Floats) -> np.ndarray:
    knot = np.empty(len(at_s), dtype=int)
    for piece in range(len(pieces.direction)):
        mine = pieces.owner == piece
        knot_s = pieces.knot_s[:, piece]
        real = int(np.searchsorted(knot_s, knot_s[-1]))          # the first of the padded ones
        knot[mine] = np.clip(np.searchsorted(knot_s, at_s[mine], side="right") - 1, 0, real - 1)
    return knot
