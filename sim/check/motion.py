"""What tracks show by themselves: where flights begin and go, how they accelerate, and where one is not free."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy.polynomial import polynomial

from truearc.sim.data.dataset import Floats, Tracks

SAMPLES = 8                           # fewest of a track that is judged; chosen: twice the numbers of a cubic
TRACKS = 3                            # fewest tracks that are judged; chosen: one slip does not decide a median
MOST = 30                             # tracks that are measured; chosen: enough for units and axes, and quick
# Chosen: drag on a light ball doubles a change of speed; a hand, a floor or a wall makes it many times as large
KICK = 3.2                            # times its usual change of velocity in the same time
JOLT = 0.2                            # and this share of its usual speed; chosen: a soft touch is left to the fit
WINDOW = 1.0 / 12.0                   # share of a track on either side, for velocities; chosen: five samples
NOISES = 8.0                          # and so many standard deviations of noise; derived: chance once in 10^15
DIFFERENCES = 20.0                    # variance of a third difference, by that of a sample; derived: 1 + 9 + 9 + 1
MEDIAN = 0.6745                       # of the size of a normal deviate; derived: normal quantile 0.75


@dataclass(frozen=True)
class Motion:
    """Measured tracks [k]: row in Shots, velocities at three moments, mean acceleration with its standard error, first
    and last place, velocity at the start. unlinked: the tracks may be those of other shots."""

    shot: Int[np.ndarray, " k"]
    velocity_m_s: Float[np.ndarray, "k 3 3"]
    bend_m_s2: Float[np.ndarray, "k 3"]
    error_m_s2: Floats
    from_m: Float[np.ndarray, "k 3"]
    to_m: Float[np.ndarray, "k 3"]
    start_m_s: Float[np.ndarray, "k 3"]
    unlinked: bool = False

    def read(self, matrix: Floats, seconds: float = 1.0, by_m: Floats | float = 0.0) -> "Motion":
        """The same with positions times a matrix [3, 3], plus `by_m`, and times multiplied by `seconds`."""
        turn, size = matrix.T, float(np.linalg.norm(matrix, axis=1).max())
        return replace(self, velocity_m_s=self.velocity_m_s @ turn / seconds,
                       bend_m_s2=self.bend_m_s2 @ turn / seconds**2, error_m_s2=self.error_m_s2 * size / seconds**2,
                       from_m=self.from_m @ turn + by_m, to_m=self.to_m @ turn + by_m,
                       start_m_s=self.start_m_s @ turn / seconds)


def measure_motion(tracks: Tracks, without: frozenset[int] = frozenset()) -> Motion | None:
    """Fit each track but those of shots `without` by a polynomial; None where there are too few."""
    measured = []
    for shot, t_s, places in _sampled(tracks):
        if shot in without:
            continue
        half_s, scaled = np.ptp(t_s) / 2.0, 2.0 * (t_s - t_s[0]) / np.ptp(t_s) - 1.0
        degree = 4 if len(t_s) >= 2 * SAMPLES else 3
        fit, basis = polynomial.polyfit(scaled, places, degree), polynomial.polyvander(scaled, degree)
        noise_m = np.sqrt(((places - basis @ fit)**2).sum() / (3.0 * max(len(scaled) - degree - 1, 1)))
        slope = polynomial.polyder(fit) / half_s
        at = np.array([-0.5, 0.0, 0.5])
        measured.append((shot, polynomial.polyval(at, slope).T,
                         polynomial.polyval(at, polynomial.polyder(slope)).mean(axis=1) / half_s,
                         2.0 * noise_m * np.sqrt(np.linalg.pinv(basis.T @ basis)[2, 2]) / half_s**2,
                         *polynomial.polyval(np.array([-1.0, 1.0]), fit).T, polynomial.polyval(-1.0, slope)))
    if len(measured) < TRACKS:
        return None
    kept = np.linspace(0, len(measured) - 1, min(MOST, len(measured))).astype(int)
    columns: list[Any] = [np.array(column) for column in zip(*(measured[row] for row in kept), strict=True)]
    return Motion(*columns)


def _sampled(tracks: Tracks) -> Iterator[tuple[int, Floats, Float[np.ndarray, "n 3"]]]:
    """Shot, times and places of each track with enough samples."""
    points = np.column_stack([tracks.x_m, tracks.y_m, tracks.z_m])
    sound = np.asarray(np.isfinite(points).all(axis=1))
    for shot, rows in tracks.by_shot():
        here = rows[sound[rows]]
        if len(here) >= SAMPLES and (np.diff(tracks.t_s[here]) > 0.0).all():
            yield shot, tracks.t_s[here], points[here]


def jolts(tracks: Tracks) -> Iterator[tuple[int, float, bool]]:
    """Shot, time and whether it is at the start, where a velocity changes at once, as no force of the air does it."""
    for shot, t_s, seen in _sampled(tracks):
        places = np.median([seen[:-2], seen[1:-1], seen[2:]], axis=0)          # one stray sample is no jolt
        t_s = t_s[1:-1]
        span = max(round(WINDOW * len(t_s)), 2)
        slope = (places[span:] - places[:-span]) / (t_s[span:] - t_s[:-span])[:, None]
        change = np.linalg.norm(slope[span:] - slope[:-span], axis=1)
        noise_m = np.median(np.abs(np.diff(places, 3, axis=0))) / MEDIAN / np.sqrt(DIFFERENCES)
        at = int(change.argmax())
        if change[at] > max(KICK * np.median(change), JOLT * np.median(np.linalg.norm(slope, axis=1)),
                            NOISES * noise_m * 2.0 / np.median(t_s[span:] - t_s[:-span])):
            early = at + span < len(t_s) / 3
            yield shot, float(t_s[at + (2 if early else 1) * span]), early
