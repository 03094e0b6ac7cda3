"""Conditions of a shot beside its configuration, which a term may follow."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from truearc.sim.data.dataset import Dataset, Shots, Traces

KELVIN = 273.15                       # at 0 deg C
WHEEL, SPEED = "wheel_", "_rad_s"     # a trace of a wheel's speed is called wheel_<name>_rad_s
BEFORE_S = 0.02                       # how long before the ball is fed a wheel's speed still counts as what it was
LEAST_CHANGE_DEG = 1e-6               # of the hood; less does not count as a move


class Circumstances(NamedTuple):
    """Conditions that a term may follow: arrays [n], or numbers; by default those of an ordinary shot.

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
    """One circumstance [n], and of which shots the data really say it."""

    value: np.ndarray
    said: np.ndarray


def circumstances_of(dataset: Dataset) -> Circumstances:
    """Circumstances of every shot of a dataset, arrays [n]; ordinary ones where the data lack them.

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
    """{field of Circumstances: its values, and of which shots the data say it}."""
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
    density = _filled(pressure) / _filled(kelvin)
    return _departure(np.where(said, density, np.nan))


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
    """Whether `age` counts what each ball has gone through: all balls are known, and when each was shot."""
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
