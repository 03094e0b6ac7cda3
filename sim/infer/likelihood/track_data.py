"""Tracks as padded arrays in the plane of each flight."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from truearc.sim.data.dataset import Tracks

FEWEST = 5                            # samples; a flight with its unknown start fits fewer whatever the physics


class TrackData(NamedTuple):
    """Measured positions of k flights, padded to a common length: arrays [k, l].

    row [k]: the unit that each belongs to. time_s starts with 0. down_m: along the ground in the direction that the
    ball was sent off, which a ball without side force keeps; up_m: above the floor. too_short: tracks left aside.
    """

    row: Int[Any, " k"]
    time_s: Float[Any, "k l"]
    down_m: Float[Any, "k l"]
    up_m: Float[Any, "k l"]
    mask: Bool[Any, "k l"]
    too_short: int


def gather_tracks(tracks: Tracks | None, rows: Int[np.ndarray, " n"]) -> TrackData | None:
    """Tracks of the shots `rows`, each with the place of its shot in `rows`; None when there are none to use."""
    if tracks is None:
        return None
    pieces = [(place, np.flatnonzero(tracks.shot == row)) for place, row in enumerate(rows)]
    kept = [(place, samples) for place, samples in pieces if len(samples) >= FEWEST]
    short = sum(0 < len(samples) < FEWEST for _, samples in pieces)
    if not kept:
        return None
    longest = max(len(samples) for _, samples in kept)
    index = np.stack([np.pad(samples, (0, longest - len(samples)), mode="edge") for _, samples in kept])
    mask = np.stack([np.arange(longest) < len(samples) for _, samples in kept])
    time_s = tracks.t_s[index] - tracks.t_s[index[:, :1]]
    down_m = _downrange(tracks.x_m[index], tracks.y_m[index], mask)
    return TrackData(np.array([place for place, _ in kept]), time_s, down_m, tracks.z_m[index], mask, short)


def _downrange(x_m: Float[np.ndarray, "k l"], y_m: Float[np.ndarray, "k l"],
               mask: Bool[np.ndarray, "k l"]) -> Float[np.ndarray, "k l"]:
    """x turned about the exit so that the flight goes straight ahead: the heading that fits y in least squares."""
    heading = np.arctan2((mask * x_m * y_m).sum(1), np.maximum((mask * x_m**2).sum(1), 1e-12))[:, None]
    return np.asarray(x_m * np.cos(heading) + y_m * np.sin(heading))
