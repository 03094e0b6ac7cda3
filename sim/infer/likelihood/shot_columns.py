"""Columns of shots by name: each as recorded, and those that are derived from them."""

from typing import Any

import numpy as np
from jaxtyping import Float

from truearc.sim.data.conditions import counts_shots, gather_circumstances
from truearc.sim.data.dataset import Dataset
from truearc.sim.physics.simulate import launch_state

ENERGY = "energy_of_wheels"           # taken by a shot, (rad/s)^2: times their inertia it is in joules
WORN = "shots_of_ball"                # that its ball had before, by the most that any has had
Each = Float[np.ndarray, " n"]        # a number of each shot


def every_column(dataset: Dataset) -> dict[str, Any]:
    """All that is known of each shot by name: numbers [n], and texts."""
    return {**{name: dataset.shots.text(name) for name in dataset.shots.texts}, **number_columns(dataset)}


def number_columns(dataset: Dataset) -> dict[str, Each]:
    """Every number a shot, by name: as recorded, and derived."""
    columns = {"t_s": dataset.shots.number("t_s"), **dataset.shots.numbers}
    derived = launch_state(dataset.facts, dataset.shots), *(
        derive(dataset) for derive in (_time_columns, _circumstance_columns, _trace_columns))
    for more in derived:
        columns |= {name: values for name, values in more.items() if name not in columns}
    return columns


def _time_columns(dataset: Dataset) -> dict[str, Each]:
    """Place of each shot in its session, and the wait since the shot before; none where a shot has no time."""
    shots = dataset.shots
    if not shots.timed:
        return {}
    sessions = np.array(shots.text("session"))
    order, wait = np.zeros(len(shots)), np.full(len(shots), np.nan)
    for session in np.unique(sessions):
        rows = np.flatnonzero(sessions == session)
        rows = rows[np.argsort(shots.number("t_s")[rows], kind="stable")]
        order[rows] = np.arange(len(rows))
        wait[rows[1:]] = np.diff(shots.number("t_s")[rows])
    return {"order_in_session": order, "since_last_shot_s": wait}


def _circumstance_columns(dataset: Dataset) -> dict[str, Each]:
    """What terms follow and no column says as it is: the way the hood came, the wheels' dip, the ball's earlier shots.
    """
    wanted = {"hood_change": "hood_change", "droop": "wheel_dip"}
    wanted |= {"age": WORN} if counts_shots(dataset.shots) else {}
    found = gather_circumstances(dataset)
    return {name: np.where(found[field].said, found[field].value, np.nan) for field, name in wanted.items()}


def _trace_columns(dataset: Dataset) -> dict[str, Each]:
    """Of each telemetry signal its value when the ball is fed, and how far it dips below that; the wheels' energy."""
    if dataset.traces is None:
        return {}
    traces, n = dataset.traces, len(dataset.shots)
    signals = np.array(traces.signal)
    columns: dict[str, Each] = {}
    for signal in np.unique(signals):
        first, lowest = np.full(n, np.nan), np.full(n, np.nan)
        here = np.flatnonzero(signals == signal)
        here = here[np.lexsort((traces.t_s[here], traces.shot[here]))]
        shots, starts = np.unique(traces.shot[here], return_index=True)
        for shot, rows in zip(shots, np.split(here, starts[1:]), strict=True):
            fed = np.abs(traces.t_s[rows]).argmin()
            first[shot] = traces.value[rows[fed]]
            lowest[shot] = first[shot] - traces.value[rows[fed:]].min()
        columns |= {f"fed_{signal}": first, f"dip_{signal}": lowest}
    return columns | _energy_column(columns)


def _energy_column(columns: dict[str, Each]) -> dict[str, Each]:
    """Energy that the wheels give the ball or lose beside it: half the drop of their squared speeds, summed, which
    is energy over the inertia that no file states. A ball that leaves slower than what it took would have it has lost
    the rest: squeezed, slipped, rubbed."""
    wheels = [name.removeprefix("fed_") for name in columns if name.startswith("fed_wheel_")]
    if not wheels:
        return {}
    drops = [0.5 * (columns[f"fed_{one}"]**2 - (columns[f"fed_{one}"] - columns[f"dip_{one}"])**2) for one in wheels]
    return {ENERGY: np.sum(drops, axis=0)}
