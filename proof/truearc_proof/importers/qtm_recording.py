"""Motion capture as Qualisys Track Manager exports it (JSON): each marker's way, cut to its free flight.

proof/IMPORTERS.md says which keys are read.
"""

from pathlib import Path

import msgspec
import numpy as np
from jaxtyping import Bool, Float
from msgspec import Struct

from truearc.errors import InputError

GRAVITY_M_S2 = 9.81
WINDOW_S = 0.15                       # over which acceleration is fitted: 1 mm of cameras' disagreement is 0.5 m/s2
SLACK_M_S2 = 2.0                      # drag of a light ball at 8 m/s; a ball at rest is five times as far off
MM_PER_M = 1000.0
LEAST_HZ, MOST_HZ = 20.0, 100_000.0   # fewer: three frames in a window
FARTHEST = 2**53                      # of frames and mm: beyond, neighbours are not told apart


class _Range(Struct, rename="pascal"):
    start: int


class _Part(Struct, rename="pascal"):
    range: _Range
    values: list[tuple[float, float, float, float]]       # x, y, z and residual, mm


class _Marker(Struct, rename="pascal"):
    name: str
    parts: list[_Part]


class _Timebase(Struct, rename="pascal"):
    frequency: float


class _Recording(Struct, rename="pascal"):
    timebase: _Timebase
    markers: list[_Marker]


def load_free_flights(path: Path) -> dict[str, Float[np.ndarray, "_ 4"]]:
    """Return the longest free flight of each marker, by its name: t_s from the recording's begin, then x, y, z in m.

    Axes as in the recording, z up. A marker that never flies has no samples. InputError: no such recording, two markers
    of one name, a frequency, frame or place out of range.
    """
    try:
        recording = msgspec.json.decode(path.read_bytes(), type=_Recording)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: is not a recording of Qualisys Track Manager (JSON): {error}") from None
    rate_hz = recording.timebase.frequency
    if not LEAST_HZ <= rate_hz <= MOST_HZ:
        raise InputError(f"{path}: Timebase: Frequency: {rate_hz:g}; expected {LEAST_HZ:g} to {MOST_HZ:g} Hz")
    flights: dict[str, Float[np.ndarray, "_ 4"]] = {}
    for marker in recording.markers:
        for part in marker.parts:
            if abs(part.range.start) > FARTHEST or any(abs(one) > FARTHEST for row in part.values for one in row):
                raise InputError(f"{path}: Markers: {marker.name!r} has a frame or place beyond 2**53")
        if marker.name in flights:
            raise InputError(f"{path}: Markers: two have the name {marker.name!r}")
        flights[marker.name] = max((_free_flight(part, rate_hz) for part in marker.parts), key=len,
                                   default=np.empty((0, 4)))
    return flights


def _free_flight(part: _Part, rate_hz: float) -> Float[np.ndarray, "_ 4"]:
    """Of frames that follow each other the longest run in which gravity alone, or nearly so, bends the way."""
    place_m = np.array(part.values).reshape(-1, 4)[:, :3] / MM_PER_M
    half = max(round(WINDOW_S * rate_hz / 2.0), 2)
    width = 2 * half + 1
    if len(place_m) < width:
        return np.empty((0, 4))
    begin, end = _longest_run(_falls(place_m, half, rate_hz))
    if begin == end:
        return np.empty((0, 4))
    here = slice(begin + half, end + half)                # the middles of these windows, clear of hand and floor
    t_s = (part.range.start + np.arange(len(place_m))) / rate_hz
    return np.column_stack([t_s, place_m])[here]


def _falls(place_m: Float[np.ndarray, "k 3"], half: int, rate_hz: float) -> Bool[np.ndarray, " windows"]:
    """Whether a parabola through each window accelerates as a falling ball."""
    t_s = np.arange(-half, half + 1) / rate_hz
    second = np.linalg.pinv(np.vander(t_s, 3))[0]         # of t squared
    acceleration = 2.0 * np.stack([np.convolve(one, second[::-1], "valid") for one in place_m.T], axis=1)
    off = np.linalg.norm(acceleration + np.array([0.0, 0.0, GRAVITY_M_S2]), axis=1)
    return np.asarray(off < SLACK_M_S2)


def _longest_run(wanted: Bool[np.ndarray, " k"]) -> tuple[int, int]:
    """Begin and end of the longest run of True, the first of equals; (0, 0) where there is none."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], wanted, [False]])))
    runs = list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
    return max(runs, key=lambda run: run[1] - run[0], default=(0, 0))
