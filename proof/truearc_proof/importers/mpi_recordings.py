"""HDF5 recordings of the three-wheel launcher, as its public code writes and reads them -> the tables that mpi reads.

A file has a group `originals`, and in it one a launch: its parameters, time stamps and positions. Recordings with a
robot have other names for them, and an id a sample, below 0 where no ball was seen.
"""

import re
from pathlib import Path
from typing import Any

import numpy as np

from truearc.errors import InputError
from truearc.sim.data.table import Cell, Problems, RawTable
from truearc_proof.importers.originals import needed, part

PARAMETERS = ("phi_cmd", "theta_cmd", "motor_top_left_rpm", "motor_top_right_rpm", "motor_bottom_rpm")
BALL = ("launch_param", "time_stamps", "positions")
WITH_ROBOT = ("launch_parameter", "ball_time_stamps", "ball_positions")
MOTOR = r"^mn\d+_"                    # of a file's name: the launcher's motors, which do not identify the set
NS = 1e-9
LONGEST_STEP_S = 1e3                  # between two samples: the recorder's clock counts nanoseconds, its files seconds


def load_recording(path: Path, problems: Problems) -> list[tuple[RawTable, RawTable]]:
    """Launch and track of each group, by number; a bad number's line is its place in the launch's array, from 1.

    InputError where the file cannot be read or a group has not what it needs.
    """
    h5py = needed("h5py", path)
    try:
        with h5py.File(path, "r") as file:
            originals = file.get("originals")
            if not isinstance(originals, h5py.Group) or not len(originals):
                raise InputError(f"{path}: has no group 'originals' with launches in it")
            groups = {name: originals[name] for name in sorted(originals, key=lambda name: (len(name), name))}
            for name, group in groups.items():
                if not isinstance(group, h5py.Group):
                    raise InputError(f"{part(path, f'group {name}')}: is not a group")
            return [_launch(path, name, group, problems) for name, group in groups.items()]
    except (OSError, RuntimeError, KeyError) as error:
        raise InputError(f"{path}: not a readable HDF5 file ({error})") from error


def _launch(path: Path, name: str, group: Any, problems: Problems) -> tuple[RawTable, RawTable]:
    here = part(path, f"group {name}")
    names = WITH_ROBOT if "ball_positions" in group else BALL
    parameters, stamps, positions = (_array(group, dataset, here) for dataset in names)
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
    ids = _array(group, "ball_ids", here)
    if ids.shape != (count,):
        raise InputError(f"{here}: ball_ids has not one for each sample")
    return np.flatnonzero(ids >= 0)


def _seconds(stamps: np.ndarray) -> np.ndarray:
    """Times from the first stamp; no camera waits for a quarter of an hour, and none is as fast as a nanosecond."""
    exact = stamps.astype(np.int64) if stamps.dtype.kind == "u" else stamps
    since = (exact - exact[:1]).astype(float)
    return since * NS if len(since) > 1 and np.median(np.diff(since)) > LONGEST_STEP_S else since


def _array(group: Any, name: str, here: Path) -> np.ndarray:
    if name not in group:
        raise InputError(f"{here}: {name} is missing")
    array = np.asarray(group[name])
    if array.dtype.kind not in "fiu":
        raise InputError(f"{here}: {name} holds no numbers")
    return array
