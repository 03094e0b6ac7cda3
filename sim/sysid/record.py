"""The data of a fit: an effort over time and the speeds it caused, cut into pieces of motion in one direction."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from truearc.robot.config.schema import InputError

Floats = npt.NDArray[np.float64]
MARGIN_S = 0.1                        # the longest delay that is looked for, either way
PIECES = 24                           # about as many are cut, no shorter or longer than these:
SHORTEST_S, LONGEST_S = 0.4, 4.0
MIN_SAMPLES = 8                       # of a piece
MIN_PIECES = 6
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
        pieces += [Run(run.direction, int(a), int(b)) for a, b in pairwise(edges)
                   if b - a >= MIN_SAMPLES]
    if len(pieces) < MIN_PIECES:
        raise InputError(f"{record.name}: {moving_s:.1f} s of motion in {len(pieces)} pieces; at least {MIN_PIECES} "
                       f"pieces of {SHORTEST_S:g} s are needed")
    return pieces
