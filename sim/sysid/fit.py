"""The law of motion fitted to speeds: trajectories, never derivatives of what was measured.

Every piece has a starting speed of its own, so what disturbs one does not follow it into the next.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from truearc.sim.sysid.motion import Floats, Law, Record, Run, cut, expect, find_runs, lay_out
from truearc.sim.sysid.solve import fit_least_squares, fit_start_speeds, jackknife_covariance

FOLDS = 3
NORMAL90 = NormalDist().inv_cdf(0.95)
MAX_ERROR_RATIO = 0.75                # a bend must bring the error on unseen pieces down to this share


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
    """What one record says of one law.

    `forecast_rad_s` is for `rows` of the record: each run simulated from its start on efforts alone, by a fit without
    the third of the pieces that the row is in. `r2` and `rms_rad_s` are of that.
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
    """Fit the straight law, or that with windage where it brings the error on unseen pieces below MAX_ERROR_RATIO.

    InputError when the record holds too little motion to tell the numbers apart.
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
    """(ks, kv) of the straight line that comes nearest to the fitted friction, over the speeds that occurred.

    Forwards; of a straight law its own numbers. Every speed counts alike, however long the wheel stayed there.
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
