"""Two datasets of one rig as one."""

from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from truearc.sim.data.model import Dataset, Samples, Shots

Table = TypeVar("Table", bound=Samples)


def join_datasets(first: Dataset, second: Dataset) -> Dataset:
    """The shots of both, the first's before the second's; name, rig and what was left out are the first's.

    A column that only one of them has is missing in the other's shots. ValueError when a shot_id is in both.
    """
    if set(first.shots.shot_id) & set(second.shots.shot_id):
        raise ValueError("the two datasets have a shot_id in common")
    n = len(first.shots)
    return replace(first, shots=_join_shots(first.shots, second.shots),
                   tracks=_join(first.tracks, second.tracks, n), traces=_join(first.traces, second.traces, n))


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
