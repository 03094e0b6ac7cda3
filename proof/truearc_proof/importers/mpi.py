"""The importer of flights from a three-wheel table-tennis launcher (ball_prediction, MPI for Intelligent Systems).

proof/IMPORTERS.md describes the columns, the origin of the files, and the assumptions.

An HDF5 recording has a group `originals`, which contains a group for each launch with its parameters, timestamps and
positions. Recordings made with a robot use other names for these, and give each sample an id, which is below 0 if no
ball was seen.
"""

import math
import re
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Air, Ball, Believe, LauncherFacts, Noise, Rig, Site, Tracker, Wheel
from truearc.sim.data.dataset import Dataset, Shots
from truearc.sim.data.table import (
    Cell,
    Problems,
    RawTable,
    gathered,
    load_table,
    need_columns,
    number_column,
    text_column,
)
from truearc_proof.importers.originals import group_rows, part, tracks_of

LAUNCH_COLUMNS = ("set", "launch", "phi_cmd", "theta_cmd", "motor_top_left_rpm", "motor_top_right_rpm",
                  "motor_bottom_rpm", "n_samples")
TRACK_COLUMNS = ("set", "launch", "t_s", "x_m", "y_m", "z_m")
# name, clock position seen along the exit direction; even spacing is assumed
WHEELS = (("top_left", 300.0), ("top_right", 60.0), ("bottom", 180.0))
WHEEL_RADIUS_M = 0.04                 # assumed: with it the no-spin sets leave at the speed of wheels that do not slip
BALL = Ball(mass_kg=0.0027, radius_m=0.02)
TRACK_NOISE_M = 0.002                 # scatter of the samples around a smooth flight, the worst of the three axes
# not stated: cameras that were calibrated together, on a floor that was treated as level
TRACKER = Tracker(scale_sd=0.01, tilt_sd_deg=1.0, clock_sd=0.005)
RELEASE_HEIGHT_M = 1.104              # not stated; where the published flights begin, so that all imports have one rig
RIG = Rig(ball=BALL, launcher=LauncherFacts(
    release_height_m=RELEASE_HEIGHT_M,
    wheel=tuple(Wheel(name, WHEEL_RADIUS_M, 1.0, clock_deg) for name, clock_deg in WHEELS)),
    air=Air(1.2), noise=Noise(track_m=TRACK_NOISE_M), tracker=TRACKER, site=Site(indoor=True),
    believe=Believe(("gravity", "drag", "magnus")))
RPM = 2.0 * math.pi / 60.0
FALL_M = 0.05                         # below the highest sample so far: the ball is on its way down
RISE_M = 0.01                         # above the lowest one, twice running: it has bounced
SHORTEST = 8                          # samples that a flight needs
PARAMETERS = ("phi_cmd", "theta_cmd", "motor_top_left_rpm", "motor_top_right_rpm", "motor_bottom_rpm")
BALL_NAMES = ("launch_param", "time_stamps", "positions")
ROBOT_NAMES = ("launch_parameter", "ball_time_stamps", "ball_positions")
MOTOR = r"^mn\d+_"                    # of a file's name: the launcher's motors, which do not identify the set
NS = 1e-9
LONGEST_STEP_S = 1e3                  # between two samples: the recorder's clock counts nanoseconds, its files seconds


def import_mpi(*files: str | Path) -> Dataset:
    """Read two CSV files, launches and tracks, or any number of HDF5 recordings; flights end before the bounce.

    Frame as measured: x down the table, y left, z up from the floor. `t_s` is counted from each flight's first sample.
    InputError names file, line (of a recording: group and sample) and column of each bad row.
    """
    with gathered() as problems:
        read = [_launches(launches, tracks, problems) for launches, tracks in _tables(list(map(Path, files)), problems)]
        shot_id = [name for ids, *_ in read for name in ids]
        for name in sorted({name for name in shot_id if shot_id.count(name) > 1}):
            problems.add(", ".join(map(str, files)), "", f"launch {name} stands twice")
    _, sessions, columns, flights = zip(*read, strict=True)
    numbers = {name: np.concatenate([some[name] for some in columns]) for name in columns[0]}
    cut = [_before_bounce(samples) for some in flights for samples in some]
    kept = [row for row, samples in enumerate(cut) if len(samples) >= SHORTEST]
    left_out = tuple(f"{name}: fewer than {SHORTEST} samples before the bounce"
                     for row, name in enumerate(shot_id) if row not in kept)
    shots = Shots(tuple(shot_id), numbers, {"session": sum(sessions, ())}).take(kept)
    return Dataset("mpi", RIG, shots, tracks_of([cut[row] for row in kept]), None, left_out)


def _tables(files: list[Path], problems: Problems) -> list[tuple[RawTable, RawTable]]:
    """Launches and their tracks: of all in two CSV files, of each by itself in recordings."""
    if files[0].suffix.lower() == ".hdf5":
        return [pair for path in files for pair in load_recording(path, problems)]
    launches, tracks = files
    return [(load_table(launches, problems), load_table(tracks, problems))]


def _launches(table: RawTable, tracks: RawTable, problems: Problems
              ) -> tuple[list[str], tuple[str, ...], dict[str, np.ndarray], list[np.ndarray]]:
    """Of each launch its name, set-launch, which may stand once, its set, numbers, and samples [k, 4]: t_s x_m y_m z_m,
    of which there must be as many as the launch says: a lost part of the tracks shows."""
    need_columns(table, LAUNCH_COLUMNS)
    sets, names = text_column(table, "set", problems), text_column(table, "launch", problems)
    ids = [f"{name}-{launch}" for name, launch in zip(sets, names, strict=True)]
    for row, one in enumerate(ids):
        if one in ids[:row]:
            problems.add(table.place(row), "launch", f"set {sets[row]!r} has launch {names[row]} already")
    numbers = {name: number_column(table, name, problems) for name in ("phi_cmd", "theta_cmd", "n_samples")}
    numbers |= {f"wheel_{wheel}_rad_s": number_column(table, f"motor_{wheel}_rpm", problems) * RPM
                for wheel, _ in WHEELS}
    samples = _flights(tracks, ids, problems)
    for row, wanted in enumerate(numbers.pop("n_samples")):
        if math.isfinite(wanted) and len(samples[row]) != wanted:
            problems.add(table.place(row), "n_samples", f"is {wanted:g}, but the tracks have {len(samples[row])}")
    return ids, sets, numbers, samples


def _flights(table: RawTable, ids: list[str], problems: Problems) -> list[np.ndarray]:
    """The samples of each launch, as they stand; times must grow within one."""
    need_columns(table, TRACK_COLUMNS)
    columns = np.stack([number_column(table, name, problems) for name in ("t_s", "x_m", "y_m", "z_m")], axis=1)
    keys = list(zip(table.columns["set"], table.columns["launch"], strict=True))
    for row, (name, launch) in enumerate(keys):
        if f"{name}-{launch}" not in ids:
            problems.add(table.place(row), "launch", f"set {name!r} launch {launch} is not among the launches")
    rows_of = group_rows([f"{name}-{launch}" for name, launch in keys], columns[:, 0], table, problems, "launch")
    return [columns[rows_of.get(one, [])] for one in ids]


def _before_bounce(samples: np.ndarray) -> np.ndarray:
    """The samples before the one nearest to the first bounce, time from 0.

    The bounce is the lowest height after the ball has begun to fall and before two samples running (or the last one)
    are clearly above it, or before whatever follows it; the sample there is dropped too: it may lie on either side.
    """
    z_m = samples[:, 3]
    falling = np.flatnonzero(z_m < np.maximum.accumulate(z_m) - FALL_M) if len(z_m) else np.zeros(0, int)
    end = len(z_m)
    if len(falling):
        z_fall = z_m[falling[0]:]
        up = z_fall > np.minimum.accumulate(z_fall) + RISE_M
        twice = np.flatnonzero(up & np.append(up[1:], True))
        lowest = int(z_fall[:twice[0] + 1].argmin() if len(twice) else z_fall.argmin())
        # a flight that stops on its lowest sample was still falling
        if lowest < len(z_fall) - 1:
            end = falling[0] + lowest
    cut = samples[:end].copy()
    cut[:, 0] -= cut[0, 0] if len(cut) else 0.0
    return cut


def load_recording(path: Path, problems: Problems) -> list[tuple[RawTable, RawTable]]:
    """Load launch and track of each group, by number; a bad number's line is its index in the launch's array, from 1.

    InputError if the file cannot be read or a group is incomplete.
    """
    try:
        with h5py.File(path, "r") as file:
            originals = file.get("originals")
            if not isinstance(originals, h5py.Group) or not len(originals):
                raise InputError(f"{path}: has no group 'originals' with launches in it")
            groups = {name: originals[name] for name in sorted(originals, key=lambda name: (len(name), name))}
            for name, group in groups.items():
                if not isinstance(group, h5py.Group):
                    raise InputError(f"{part(path, f'group {name}')}: is not a group")
            return [_launch_of(path, name, group, problems) for name, group in groups.items()]
    except (OSError, RuntimeError, KeyError) as error:
        raise InputError(f"{path}: not a readable HDF5 file ({error})") from error


def _launch_of(path: Path, name: str, group: Any, problems: Problems) -> tuple[RawTable, RawTable]:
    here = part(path, f"group {name}")
    names = ROBOT_NAMES if "ball_positions" in group else BALL_NAMES
    parameters, stamps, positions = (_numbers_of(group, dataset, here) for dataset in names)
    if parameters.shape != (len(PARAMETERS),):
        raise InputError(f"{here}: {names[0]} has not {len(PARAMETERS)} numbers ({', '.join(PARAMETERS)})")
    if stamps.ndim != 1 or (len(stamps) and positions.shape != (len(stamps), 3)):
        raise InputError(f"{here}: {names[2]} has not 3 numbers for each of {names[1]}")
    for motor, rpm in zip(PARAMETERS[2:], parameters[2:], strict=True):
        if rpm <= 1.0:
            problems.add(str(here), motor, f"{rpm:g} is not a speed in rpm (thrown by hand, or a share of full power?)")
    seen = _seen(group, len(stamps), here)
    key: dict[str, Cell] = {"set": re.sub(MOTOR, "", path.stem), "launch": name}
    launch = {**key, **dict(zip(PARAMETERS, map(float, parameters), strict=True)), "n_samples": float(len(seen))}
    samples = np.column_stack([_seconds(stamps), positions.reshape(-1, 3)])[seen]
    track: dict[str, list[Cell]] = {column: [cell] * len(seen) for column, cell in key.items()}
    track |= dict(zip(("t_s", "x_m", "y_m", "z_m"), samples.T.tolist(), strict=True))
    return (RawTable(here, {column: [cell] for column, cell in launch.items()}, [1]),
            RawTable(here, track, (seen + 1).tolist()))


def _seen(group: Any, count: int, here: Path) -> np.ndarray:
    """Which samples are of a ball."""
    if "ball_ids" not in group:
        return np.arange(count)
    ids = _numbers_of(group, "ball_ids", here)
    if ids.shape != (count,):
        raise InputError(f"{here}: ball_ids has not one for each sample")
    return np.flatnonzero(ids >= 0)


def _seconds(stamps: np.ndarray) -> np.ndarray:
    """Times from the first stamp; no camera waits for a quarter of an hour, and none is as fast as a nanosecond."""
    exact = stamps.astype(np.int64) if stamps.dtype.kind == "u" else stamps
    since = (exact - exact[:1]).astype(float)
    return since * NS if len(since) > 1 and np.median(np.diff(since)) > LONGEST_STEP_S else since


def _numbers_of(group: Any, name: str, here: Path) -> np.ndarray:
    if name not in group:
        raise InputError(f"{here}: {name} is missing")
    array = np.asarray(group[name])
    if array.dtype.kind not in "fiu":
        raise InputError(f"{here}: {name} holds no numbers")
    return array
