"""What of the shots hangs together: what differs by luck, in groups, and what each shot has for itself."""

from dataclasses import dataclass

import numpy as np

from truearc.sim.data.dataset import Shots
from truearc.sim.discover.model.score_table import Array

MOST_GROUPED = 0.34                   # groups a shot: with fewer than three shots each nothing would be left to ask
MANY = 10.0                           # groups, counted by size, from which they and not the shots hang together


@dataclass(frozen=True)
class Clusters:
    """What hangs together: `label` [shots] numbers the clusters; `by` ball_id, session or shot."""

    by: str
    label: Array
    count: int


def find_clusters(shots: Shots) -> Clusters:
    """What luck holds together once groups have their own effects: each shot by itself."""
    return Clusters("shot", np.arange(len(shots)), len(shots))


def groups_of(shots: Shots, rows: Array) -> tuple[str, Array, int] | None:
    """(what, label [n] of these rows, how many): balls when there are at least ten, else sessions when there are.

    Counted as (sum of sizes)^2 / sum of squares, so that a big group and its crumbs are not many. Many groups differ by
    luck, and that is no finding; with fewer a difference between them counts as one, for it could be known.
    """
    for name in ("ball_id", "session"):
        texts = np.array(shots.text(name))[rows]
        if not any(texts):
            continue
        levels, label, sizes = np.unique(texts, return_inverse=True, return_counts=True)
        if sizes.sum()**2 / (sizes**2).sum() >= MANY and len(levels) <= MOST_GROUPED * len(rows):
            return name, label, len(levels)
    return None
