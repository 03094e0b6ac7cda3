"""Least squares of speeds: the law's numbers and a starting speed for every piece."""

from collections.abc import Sequence

import numpy as np

from truearc.errors import InputError
from truearc.sim.sysid.motion import MARGIN_S, Floats, Law, Pieces, Record, Run, expect, lay_out

MAX_STEPS = 100
SETTLED = 1e-9                        # relative fall of the sum of squares that ends the search
MAX_DAMPING = 1e9                     # damping at which no step helps any more
DIFFERENCE = 1e-5                     # relative, of the slopes; seconds, of the delay's
MAX_CONDITION = 1e12                  # condition of the information at which numbers can no longer be told apart


def fit_least_squares(record: Record, law: Law, cuts: Sequence[Run],
                      guess: Floats | None = None) -> tuple[Floats, Floats]:
    """(the law's numbers, every piece's starting speed) by Levenberg-Marquardt; InputError when it does not settle."""
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
    """Each piece's starting speed that fits best with the law as it is; the speed is all but linear in it."""
    start = pieces.start_rad_s
    for _ in range(2):
        step = DIFFERENCE * (1.0 + np.abs(pieces.speed_rad_s).max())
        flown = expect(law, np.stack([values, values]), np.stack([start, start + step]), pieces)
        slope, residual = (flown[1] - flown[0]) / step, pieces.speed_rad_s - flown[0]
        start = start + _by_piece(slope * residual, pieces) / _by_piece(slope**2, pieces)
    return start


def linearise(law: Law, values: Floats, start: Floats, pieces: Pieces) -> tuple[Floats, Floats]:
    """Residuals [samples], and slopes of what is expected [samples, numbers + pieces]."""
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
    """Covariance of the law's numbers by the jackknife: each piece left out once, in one linear step.

    Residuals of one piece may be as alike as they like; only pieces must be independent. No number is surer than it
    would be if all residuals were: the jackknife of few pieces is at times too sure by chance. InputError when the
    numbers cannot be told apart, or all that tells them is one piece.
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
