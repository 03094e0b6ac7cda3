"""Tracker faults applied to correct tracks: none of them is physics of the ball.

They act on the tracks as recorded and use nothing of truearc.sim.physics.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from truearc.sim.data.dataset import Dataset, Tracks

LONG = 1.05                           # too long a metre, too slow a clock
TILT_DEG, TURN_DEG = 4.0, 5.0
SHRINKING = -0.02                     # of the scale, per m of height
LOST_FRAMES = 2                       # in the middle of a flight, without saying so


def too_long(tracks: Tracks) -> Tracks:
    """A metre measured in the wrong plane."""
    return replace(tracks, x_m=LONG * tracks.x_m, y_m=LONG * tracks.y_m, z_m=LONG * tracks.z_m)


def wrong_rate(tracks: Tracks) -> Tracks:
    """Frames come at another rate than stated."""
    return replace(tracks, t_s=LONG * tracks.t_s)


def lost_frames(tracks: Tracks) -> Tracks:
    """In the middle of each track the camera drops frames, and what follows is stamped as if it had not."""
    t_s, kept = tracks.t_s.copy(), np.ones(len(tracks.t_s), dtype=bool)
    for shot in np.unique(tracks.shot):
        mine = np.flatnonzero(tracks.shot == shot)
        mine = mine[np.argsort(t_s[mine])]
        lost, later = np.split(mine[len(mine) // 2:], [LOST_FRAMES])
        kept[lost] = False
        t_s[later] -= LOST_FRAMES * np.median(np.diff(tracks.t_s[mine]))
    return Tracks(tracks.shot[kept], t_s[kept], tracks.x_m[kept], tracks.y_m[kept], tracks.z_m[kept])


def tilted(tracks: Tracks) -> Tracks:
    """The camera's horizon is not level: what lies ahead seems higher."""
    cosine, sine = math.cos(math.radians(TILT_DEG)), math.sin(math.radians(TILT_DEG))
    return replace(tracks, x_m=cosine * tracks.x_m - sine * tracks.z_m, z_m=cosine * tracks.z_m + sine * tracks.x_m)


def turned(tracks: Tracks) -> Tracks:
    """The tracker's frame is not the launcher's: its x axis points beside the target."""
    cosine, sine = math.cos(math.radians(TURN_DEG)), math.sin(math.radians(TURN_DEG))
    return replace(tracks, x_m=cosine * tracks.x_m - sine * tracks.y_m, y_m=cosine * tracks.y_m + sine * tracks.x_m)


def shrinking(tracks: Tracks) -> Tracks:
    """The camera looks up: the higher, the farther off and the smaller."""
    scale = 1.0 + SHRINKING * tracks.z_m
    return replace(tracks, x_m=scale * tracks.x_m, y_m=scale * tracks.y_m, z_m=scale * tracks.z_m)


FAULTS: dict[str, Callable[[Tracks], Tracks]] = {
    "scale 5 % too long": too_long, "clock 5 % slow": wrong_rate, "2 frames lost": lost_frames,
    "tilted 4 deg": tilted, "turned 5 deg": turned, "2 % smaller per m": shrinking}


def with_fault(dataset: Dataset, fault: str) -> Dataset:
    """The dataset as a tracker with this fault of FAULTS would have left it; KeyError for another."""
    assert dataset.tracks is not None
    return replace(dataset, tracks=FAULTS[fault](dataset.tracks))
