"""The importer of a ball-throwing robot's throws, tracked by motion capture (Jugglebot's Ball Butler).

proof/IMPORTERS.md describes the columns, the origin of the files, and the assumptions.
"""

import math
from pathlib import Path

import msgspec
import numpy as np
from jaxtyping import Bool, Float
from msgspec import Struct

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Air, Ball, Believe, LauncherFacts, Noise, Rig, Site, Tracker
from truearc.sim.data.dataset import Dataset, Shots, Tracks
from truearc.sim.data.table import Problems, gathered, load_table, need_columns, number_column, text_column
from truearc_proof.importers.originals import group_rows

COLUMNS = ("shot_id", "t_s", "x_m", "y_m", "z_m")
BALL = Ball(mass_kg=0.07, radius_m=0.035)   # the radius is not stated: that of a juggling ball of this mass
RELEASE_HEIGHT_M = 2.4                # not stated; where flights of session 3 begin, so that all imports have one rig
TRACK_NOISE_M = 0.0003                # of single samples about a smooth flight
# not stated: cameras that were calibrated together, over a floor that was treated as level
TRACKER = Tracker(scale_sd=0.01, tilt_sd_deg=1.0, clock_sd=0.001)
RIG = Rig(ball=BALL, launcher=LauncherFacts(release_height_m=RELEASE_HEIGHT_M), air=Air(1.2),
          noise=Noise(track_m=TRACK_NOISE_M), tracker=TRACKER, site=Site(indoor=True), believe=Believe(("gravity",)))
SHORTEST = 8                          # samples that a flight needs
GRAVITY_M_S2 = 9.81
WINDOW_S = 0.15                       # over which acceleration is fitted: 1 mm of cameras' disagreement is 0.5 m/s2
SLACK_M_S2 = 2.0                      # drag of a light ball at 8 m/s; a ball at rest is five times as far off
MM_PER_M = 1000.0
LEAST_HZ, MOST_HZ = 20.0, 100_000.0   # fewer: three frames in a window
FARTHEST = 2**53                      # of frames and mm: beyond, neighbours are not told apart


def import_ball_butler(*files: str | Path) -> Dataset:
    """Read one recording (JSON) or one CSV file of sampled flights; one shot per flight, with all its samples.

    From a recording, a shot is the longest free flight of a marker, named by file and marker. Frame: z up as measured;
    x along the mean horizontal direction of the flights, y to its left, both from where flights begin (the middle one).
    `t_s` counts from each flight's first sample. `session`: the recording's name, or a shot_id up to its dash.
    InputError names the file, and the key, or line and column, of each bad value.
    """
    path = Path(files[0])
    if path.suffix.lower() == ".json":
        found = {f"{path.stem}-{name}": one for name, one in load_free_flights(path).items()}
        sessions = dict.fromkeys(found, path.stem)
    else:
        with gathered() as problems:
            found = _flights(path, problems)
        sessions = {name: name.partition("-")[0] for name in found}
    left_out = tuple(f"{name}: fewer than {SHORTEST} samples" for name, one in found.items() if len(one) < SHORTEST)
    kept = {name: one for name, one in found.items() if len(one) >= SHORTEST}
    if not kept:
        raise InputError(f"{path}: has no flight of {SHORTEST} samples")
    shots = Shots(tuple(kept), {}, {"session": tuple(sessions[name] for name in kept)})
    return Dataset("ball-butler", RIG, shots, _tracks(list(kept.values())), None, left_out)


def _flights(path: Path, problems: Problems) -> dict[str, Float[np.ndarray, "k 4"]]:
    """Time and place of the samples of each flight, in the order of their first rows; times grow within one."""
    table = load_table(path, problems)
    need_columns(table, COLUMNS)
    shot = text_column(table, "shot_id", problems)
    samples = np.stack([number_column(table, name, problems) for name in COLUMNS[1:]], axis=1)
    return {name: samples[rows] for name, rows in group_rows(shot, samples[:, 0], table, problems, "flight").items()}


def _tracks(flights: list[Float[np.ndarray, "_ 4"]]) -> Tracks:
    begin_m = np.median([one[0, 1:3] for one in flights], axis=0)
    along, aside = np.mean([one[-1, 1:3] - one[0, 1:3] for one in flights], axis=0)
    turn = np.array([[along, aside], [-aside, along]]) / max(math.hypot(along, aside), 1e-12)
    t_s = np.concatenate([one[:, 0] - one[0, 0] for one in flights])
    x_m, y_m = turn @ (np.concatenate([one[:, 1:3] for one in flights]) - begin_m).T
    shot = np.repeat(np.arange(len(flights)), [len(one) for one in flights])
    return Tracks(shot, t_s, x_m, y_m, np.concatenate([one[:, 3] for one in flights]))


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
    """Return the longest free flight of each marker of a recording that Qualisys Track Manager exported (JSON).

    By marker name: t_s from the start of the recording, then x, y, z in m. Axes as in the recording, z up. A marker
    that never flies has no samples. InputError: no such recording, two markers of one name, or a frequency, frame or
    position out of range.
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
