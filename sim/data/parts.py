"""Some shots of a dataset, and two datasets of one rig as one."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from truearc.sim.data.model import Dataset, Floats, Shots, Traces, Tracks


def take_shots(dataset: Dataset, rows: Sequence[int]) -> Dataset:
    """The shots at these rows, in that order, with their tracks and traces."""
    place = np.full(len(dataset.shots), -1)
    place[list(rows)] = np.arange(len(rows))
    tracks, traces = dataset.tracks, dataset.traces
    if tracks is not None:
        here = place[tracks.shot] >= 0
        tracks = Tracks(place[tracks.shot[here]], *(part[here] for part in (tracks.t_s, tracks.x_m, tracks.y_m,
                                                                            tracks.z_m)))
    if traces is not None:
        lines = np.flatnonzero(place[traces.shot] >= 0)
        traces = Traces(place[traces.shot[lines]], traces.t_s[lines], tuple(traces.signal[k] for k in lines),
                        traces.value[lines])
    return replace(dataset, shots=dataset.shots.take(list(rows)), tracks=tracks, traces=traces)


def join_datasets(first: Dataset, second: Dataset) -> Dataset:
    """The shots of both, the first's before the second's; name, rig and what was left out are the first's.

    A column that only one of them has is missing in the other's shots. ValueError when a shot_id is in both.
    """
    if set(first.shots.shot_id) & set(second.shots.shot_id):
        raise ValueError("the two datasets have a shot_id in common")
    n = len(first.shots)
    return replace(first, shots=_join_shots(first.shots, second.shots),
                   tracks=_join_tracks(first.tracks, second.tracks, n),
                   traces=_join_traces(first.traces, second.traces, n))


def _join_shots(first: Shots, second: Shots) -> Shots:
    numbers = {name: np.concatenate([first.number(name), second.number(name)])
               for name in dict.fromkeys([*first.numbers, *second.numbers])}
    texts = {name: first.text(name) + second.text(name) for name in dict.fromkeys([*first.texts, *second.texts])}
    return Shots(first.shot_id + second.shot_id, numbers, texts, first.source)


def _join_tracks(first: Tracks | None, second: Tracks | None, n: int) -> Tracks | None:
    if first is None or second is None:
        return first if second is None else replace(second, shot=second.shot + n)

    def both(name: str) -> Floats:
        return np.concatenate([getattr(first, name), getattr(second, name)])
    return Tracks(np.concatenate([first.shot, second.shot + n]), both("t_s"), both("x_m"), both("y_m"), both("z_m"))


def _join_traces(first: Traces | None, second: Traces | None, n: int) -> Traces | None:
    if first is None or second is None:
        return first if second is None else replace(second, shot=second.shot + n)
    return Traces(np.concatenate([first.shot, second.shot + n]), np.concatenate([first.t_s, second.t_s]),
                  first.signal + second.signal, np.concatenate([first.value, second.value]))
