"""The equation of motion of a motor and its load, its exact simulation, and its fit to speeds.

    effort = ks(direction) + kv w + kq w |w| + ka dw/dt

The effort is piecewise constant, and speed readings lag by `delay`. The data of a fit are an effort over time and the
resulting speeds. They are cut into pieces of motion in one direction, within which the law and its slopes are smooth.
Least squares compares trajectories, never derivatives of measured values; every piece has its own starting speed, so
that a disturbance in one piece does not affect the next.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import NormalDist

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
MAX_STEPS = 100
SETTLED = 1e-9                        # relative fall of the sum of squares that ends the search
MAX_DAMPING = 1e9                     # damping at which no step helps any more
DIFFERENCE = 1e-5                     # relative, of the slopes; seconds, of the delay's
MAX_CONDITION = 1e12                  # condition of the information at which numbers can no longer be told apart
FOLDS = 3
NORMAL90 = NormalDist().inv_cdf(0.95)
MAX_ERROR_RATIO = 0.75                # a bend must bring the error on unseen pieces down to this share


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
    """Find the stretches of motion; a stationary joint gives no information on sliding friction."""
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
    """Return the runs in about PIECES pieces; InputError if there is too little motion for a fit."""
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
    """Pieces side by side; knots are where the effort changes, padded at the end with knots of zero length."""

    direction: Floats                 # [pieces]
    knot_s: Floats                    # [knots, pieces]
    effort: Floats                    # [knots, pieces], from this knot on
    owner: np.ndarray                 # [samples] piece of each sample
    sample_s: Floats                  # [samples]
    speed_rad_s: Floats               # [samples] as measured
    start_rad_s: Floats               # [pieces] a first guess of the speed at the first knot


def lay_out(record: Record, runs: Sequence[Run]) -> Pieces:
    """Lay out the pieces; their knots reach MARGIN_S beyond their samples at both ends."""
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
    return knots, record.effort[np.maximum(np.searchsorted(record.effort_t_s, knots, side="right") - 1, 0)]


def _early_speed(record: Record, run: Run) -> float:
    """The speed MARGIN_S before the first sample, by a line through the piece's first samples."""
    few = slice(run.first, min(run.first + 12, run.last))
    slope, level = np.polyfit(record.speed_t_s[few] - record.speed_t_s[run.first], record.speed_rad_s[few], 1)
    return float(level - slope * MARGIN_S)


@dataclass(frozen=True)
class Law:
    """The numbers in the law: friction for each direction that occurs, and windage or not."""

    directions: tuple[float, ...]
    windage: bool

    @property
    def names(self) -> tuple[str, ...]:
        frictions = tuple("ks" if direction > 0.0 else "ks_back" for direction in self.directions)
        return (*frictions, "kv", *(("kq",) if self.windage else ()), "ka", "delay_s")

    def unpack(self, values: Floats, direction: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return (signed friction, kv, kq, ka) per set of `values` [..., numbers] and piece: [..., pieces] or [...,
        1]."""
        count = len(self.directions)
        which = np.array([self.directions.index(float(one)) for one in direction])
        kq = values[..., count + 1, None] if self.windage else np.zeros_like(values[..., :1])
        return values[..., which] * direction, values[..., count, None], kq, values[..., -2, None]


def simulate(law: Law, values: Floats, start_rad_s: Floats, pieces: Pieces) -> tuple[Floats, Floats, Floats]:
    """Return speeds at knots, and accelerations just after and just before each knot's interval ends.

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
    """Return the expected speeds of the samples, [sets, samples]: cubic between knots, read `delay` late."""
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


def fit_least_squares(record: Record, law: Law, cuts: Sequence[Run],
                      guess: Floats | None = None) -> tuple[Floats, Floats]:
    """Fit (the law's numbers, every piece's starting speed) by Levenberg-Marquardt; InputError if it does not
    converge."""
    pieces = lay_out(record, cuts)
    values = _first_guess(record, law, cuts) if guess is None else guess
    start = fit_start_speeds(law, values, pieces)
    residual, slopes = linearise(law, values, start, pieces)
    misfit, damping = float(residual @ residual), 1e-3
    for _ in range(MAX_STEPS):
        step = _damped(slopes, residual, damping)
        tried, tried_start = values + step[:len(values)], start + step[len(values):]
        reached = _misfit(law, tried, tried_start, pieces)
        if reached <= misfit:
            values, start, damping = tried, tried_start, damping * 0.1
            if misfit - reached <= SETTLED * misfit:
                return values, start
            residual, slopes = linearise(law, values, start, pieces)
            misfit = reached
            continue
        damping *= 10.0
        if damping > MAX_DAMPING:
            return values, start
    raise InputError(f"{record.name}: the fit does not settle in {MAX_STEPS} steps")


def fit_start_speeds(law: Law, values: Floats, pieces: Pieces) -> Floats:
    """Fit each piece's starting speed for a fixed law; the speed is nearly linear in it."""
    start = pieces.start_rad_s
    for _ in range(2):
        step = DIFFERENCE * (1.0 + np.abs(pieces.speed_rad_s).max())
        flown = expect(law, np.stack([values, values]), np.stack([start, start + step]), pieces)
        slope, residual = (flown[1] - flown[0]) / step, pieces.speed_rad_s - flown[0]
        start = start + _by_piece(slope * residual, pieces) / _by_piece(slope**2, pieces)
    return start


def linearise(law: Law, values: Floats, start: Floats, pieces: Pieces) -> tuple[Floats, Floats]:
    """Return residuals [samples], and slopes of the expected speeds [samples, numbers + pieces]."""
    steps = DIFFERENCE * np.maximum(np.abs(values), 1e-6)
    steps[-1] = DIFFERENCE
    turn = DIFFERENCE * (1.0 + float(np.abs(pieces.speed_rad_s).max()))
    sets = np.concatenate([values[None], values + np.diag(steps), values[None]])
    starts = np.tile(start, (len(sets), 1))
    starts[-1] += turn
    flown = expect(law, sets, starts, pieces)
    own = np.zeros((flown.shape[1], len(start)))
    own[np.arange(len(own)), pieces.owner] = (flown[-1] - flown[0]) / turn
    return pieces.speed_rad_s - flown[0], np.concatenate([(flown[1:-1] - flown[0]).T / steps, own], axis=1)


def jackknife_covariance(record: Record, law: Law, values: Floats, start: Floats, cuts: Sequence[Run]) -> Floats:
    """Return the covariance of the law's numbers by the jackknife: each piece omitted once, in one linear step.

    Residuals within a piece may be correlated; only pieces must be independent. No number is more certain than it would
    be if all residuals were independent, since the jackknife of few pieces is sometimes overconfident by chance.
    InputError if the numbers cannot be separated, or only one piece separates them.
    """
    pieces = lay_out(record, cuts)
    residual, slopes = linearise(law, values, start, pieces)
    slopes, own = slopes[:, :len(values)], slopes[np.arange(len(residual)), len(values) + pieces.owner]
    scale = np.sqrt(np.sum(slopes**2, axis=0))
    if not np.all(scale > 0.0):
        raise InputError(f"{record.name}: the speed does not depend on {law.names[int(np.argmin(scale))]}")
    parts = [_part(slopes / scale, own, residual, pieces.owner == piece) for piece in range(len(cuts))]
    whole = np.sum([information for information, _ in parts], axis=0)
    left = [whole - information for information, _ in parts]
    if max(map(np.linalg.cond, left)) > MAX_CONDITION:
        raise InputError(f"{record.name}: effort and speed change too little, or only once, to tell "
                       f"{', '.join(law.names)} apart")
    moves = np.array([np.linalg.solve(rest, score) for rest, (_, score) in zip(left, parts, strict=True)]) / scale
    moves -= moves.mean(axis=0)
    jackknife = (len(parts) - 1) / len(parts) * moves.T @ moves
    noise = float(residual @ residual) / (len(residual) - len(values) - len(start))
    alone = noise * np.diag(np.linalg.inv(whole)) / scale**2
    widen = np.sqrt(np.maximum(alone / np.maximum(np.diag(jackknife), np.finfo(float).tiny), 1.0))
    return np.asarray(jackknife * np.outer(widen, widen))


def _part(slopes: Floats, own: Floats, residual: Floats, mine: np.ndarray) -> tuple[Floats, Floats]:
    """Information and score of one piece, its starting speed fitted out."""
    own = own[mine] / np.linalg.norm(own[mine])
    block, miss = slopes[mine], residual[mine]
    block = block - np.outer(own, own @ block)
    return block.T @ block, block.T @ miss


def _misfit(law: Law, values: Floats, start: Floats, pieces: Pieces) -> float:
    """Sum of squares; infinite where there is no such thing (no inertia, a delay beyond the margins)."""
    if not values[-2] > 0.0 or not abs(values[-1]) < MARGIN_S:
        return np.inf
    with np.errstate(over="ignore", invalid="ignore"):            # a step too far may fly away
        missed = pieces.speed_rad_s - expect(law, values[None], start[None], pieces)[0]
        total = float(missed @ missed)
    return total if np.isfinite(total) else np.inf


def _damped(slopes: Floats, residual: Floats, damping: float) -> Floats:
    scale = np.sqrt(np.sum(slopes**2, axis=0))
    scale[scale == 0.0] = 1.0
    scaled = slopes / scale
    matrix = scaled.T @ scaled + damping * np.eye(slopes.shape[1])
    return np.asarray(np.linalg.solve(matrix, scaled.T @ residual) / scale)


def _by_piece(values: Floats, pieces: Pieces) -> Floats:
    return np.bincount(pieces.owner, values, len(pieces.direction)).astype(float, copy=False)


def _first_guess(record: Record, law: Law, cuts: Sequence[Run]) -> Floats:
    """The law integrated over time is linear in its numbers and needs no derivative; without delay."""
    blocks = [_integrated(record, law, run) for run in cuts]
    left, right = (np.concatenate(side) for side in zip(*blocks, strict=True))
    scale = np.sqrt(np.sum(left**2, axis=0))
    scale[scale == 0.0] = 1.0
    found = np.linalg.lstsq(left / scale, right, rcond=None)[0] / scale
    if not found[-1] > 0.0:
        raise InputError(f"{record.name}: effort and speed do not go together; no inertia can be seen")
    return np.append(found, 0.0)


def _integrated(record: Record, law: Law, run: Run) -> tuple[Floats, Floats]:
    """Integrals over one piece, each less its mean, so that where the piece begins does not matter."""
    rows = slice(run.first, run.last)
    t_s, speed = record.speed_t_s[rows], record.speed_rad_s[rows]
    effort = record.effort[np.maximum(np.searchsorted(record.effort_t_s, t_s, side="right") - 1, 0)]
    friction = [run.direction * (t_s - t_s[0]) * (run.direction == direction) for direction in law.directions]
    windage = [_area(t_s, speed * np.abs(speed))] if law.windage else []
    block = np.stack([*friction, _area(t_s, speed), *windage, speed], axis=1)
    held = np.append(0.0, np.cumsum(effort[:-1] * np.diff(t_s)))
    return block - block.mean(axis=0), held - held.mean()


def _area(t_s: Floats, values: Floats) -> Floats:
    return np.append(0.0, np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(t_s)))


@dataclass(frozen=True)
class Number:
    """A fitted number and its standard deviation."""

    name: str
    value: float
    sd: float

    @property
    def low90(self) -> float:
        return self.value - NORMAL90 * self.sd

    @property
    def high90(self) -> float:
        return self.value + NORMAL90 * self.sd


@dataclass(frozen=True)
class SysidFit:
    """The fit of one law to one record.

    `forecast_rad_s` is for `rows` of the record: each run simulated from its start on efforts alone, by a fit without
    the third of the pieces that contains the row. `r2` and `rms_rad_s` refer to that forecast.
    """

    record: Record
    law: Law
    runs: tuple[Run, ...]
    pieces: tuple[Run, ...]
    numbers: dict[str, Number]
    covariance: Floats                # of the numbers, in the law's order
    rows: np.ndarray
    forecast_rad_s: Floats
    r2: float
    rms_rad_s: float

    def value(self, name: str) -> float:
        return self.numbers[name].value

    @property
    def moving_s(self) -> float:
        return sum(float(self.record.speed_t_s[run.last - 1] - self.record.speed_t_s[run.first]) for run in self.runs)


def fit_motion(record: Record) -> SysidFit:
    """Fit the straight law, or the one with windage if it brings the error on unseen pieces below MAX_ERROR_RATIO.

    InputError if the record contains too little motion to separate the numbers.
    """
    straight, bent = fit_law(record, windage=False), fit_law(record, windage=True)
    return bent if bent.rms_rad_s < MAX_ERROR_RATIO * straight.rms_rad_s else straight


def fit_law(record: Record, windage: bool) -> SysidFit:
    """Fit one law; see fit_motion."""
    runs = find_runs(record)
    cuts = cut(record, runs)
    law = Law(tuple(sorted({run.direction for run in cuts}, reverse=True)), windage)
    values, start = fit_least_squares(record, law, cuts)
    covariance = jackknife_covariance(record, law, values, start, cuts)
    rows = np.concatenate([np.arange(run.first, run.last) for run in runs])
    forecast = _forecast(record, law, values, runs, cuts, rows)
    measured = record.speed_rad_s[rows]
    missed = measured - forecast
    r2 = 1.0 - float(np.sum(missed**2) / np.sum((measured - measured.mean()) ** 2))
    numbers = {name: Number(name, float(value), float(np.sqrt(variance)))
               for name, value, variance in zip(law.names, values, np.diag(covariance), strict=True)}
    return SysidFit(record, law, tuple(runs), tuple(cuts), numbers, covariance, rows, forecast, r2,
               float(np.sqrt(np.mean(missed**2))))


def line(fit: SysidFit) -> tuple[Number, Number]:
    """Return (ks, kv) of the straight line closest to the fitted friction, over the speeds that occurred.

    Forwards; for a straight law its own numbers. Every speed counts the same, however long the wheel stayed there.
    """
    speeds = np.abs(fit.record.speed_rad_s[fit.rows])
    grid = np.linspace(speeds.min(), speeds.max(), 100)
    friction = np.zeros((len(grid), len(fit.law.names)))
    friction[:, 0], friction[:, fit.law.names.index("kv")] = 1.0, grid
    if fit.law.windage:
        friction[:, fit.law.names.index("kq")] = grid**2
    weights = np.linalg.lstsq(np.stack([np.ones(len(grid)), grid], axis=1), friction, rcond=None)[0]
    values = weights @ np.array([fit.value(name) for name in fit.law.names])
    sds = np.sqrt(np.diag(weights @ fit.covariance @ weights.T))
    ks, kv = (Number(name, float(value), float(sd)) for name, value, sd in zip(("ks", "kv"), values, sds, strict=True))
    return ks, kv


def _forecast(record: Record, law: Law, guess: Floats, runs: Sequence[Run], cuts: Sequence[Run],
              rows: np.ndarray) -> Floats:
    """Each third of the pieces by a fit to the others; only where a run begins is taken from the whole run."""
    whole = lay_out(record, runs)
    forecast = np.full(len(rows), np.nan)
    for fold in range(FOLDS):
        others = [piece for number, piece in enumerate(cuts) if number % FOLDS != fold]
        values, _ = fit_least_squares(record, law, others, guess)
        flown = expect(law, values[None], fit_start_speeds(law, values, whole)[None], whole)[0]
        for piece in cuts[fold::FOLDS]:
            mine = (rows >= piece.first) & (rows < piece.last)
            forecast[mine] = flown[mine]
    return np.where(np.isnan(forecast), flown, forecast)          # rows of no piece: the last fit has not seen them
