"""Throws of a ball-throwing robot, followed by motion capture (Jugglebot's Ball Butler) -> dataset.

proof/IMPORTERS.md says what the columns are, where the files come from, and what is assumed.
"""

import math
from pathlib import Path

import numpy as np
from jaxtyping import Float

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Air, Ball, Believe, LauncherFacts, Noise, Rig, Site, Tracker
from truearc.sim.data.columns import need_columns, number_column, text_column
from truearc.sim.data.dataset import Dataset, Shots, Tracks
from truearc.sim.data.table import Problems, gathered, load_table
from truearc_proof.importers.qtm_recording import load_free_flights

COLUMNS = ("shot_id", "t_s", "x_m", "y_m", "z_m")
BALL = Ball(mass_kg=0.07, radius_m=0.035)   # the radius is not stated: that of a juggling ball of this mass
RELEASE_HEIGHT_M = 2.4                # not stated; where flights of session 3 begin, so that all imports have one rig
TRACK_NOISE_M = 0.0003                # of single samples about a smooth flight
# not stated: cameras that were calibrated together, over a floor that was treated as level
TRACKER = Tracker(scale_sd=0.01, tilt_sd_deg=1.0, clock_sd=0.001)
RIG = Rig(ball=BALL, launcher=LauncherFacts(release_height_m=RELEASE_HEIGHT_M), air=Air(1.2),
          noise=Noise(track_m=TRACK_NOISE_M), tracker=TRACKER, site=Site(indoor=True), believe=Believe(("gravity",)))
SHORTEST = 8                          # samples that a flight needs


def import_ball_butler(*files: str | Path) -> Dataset:
    """Read one recording (JSON) or one CSV file of sampled flights; one shot a flight, all its samples kept.

    Of a recording a shot is the longest free flight of a marker; file and marker name it. Frame: z up as measured; x
    along the mean horizontal direction of the flights, y to its left, both from where flights begin (the middle one).
    `t_s` counts from each flight's first sample. `session`: the recording's name, or a shot_id up to its dash.
    InputError names the file, and in it the key, or line and column, of what is bad.
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
    rows_of: dict[str, list[int]] = {}
    for row, name in enumerate(shot):
        rows = rows_of.setdefault(name, [])
        if rows and samples[row, 0] <= samples[rows[-1], 0]:
            problems.add(table.place(row), "t_s", "does not follow the sample before of the same flight")
        rows.append(row)
    return {name: samples[rows] for name, rows in rows_of.items()}


def _tracks(flights: list[Float[np.ndarray, "_ 4"]]) -> Tracks:
    begin_m = np.median([one[0, 1:3] for one in flights], axis=0)
    along, aside = np.mean([one[-1, 1:3] - one[0, 1:3] for one in flights], axis=0)
    turn = np.array([[along, aside], [-aside, along]]) / max(math.hypot(along, aside), 1e-12)
    t_s = np.concatenate([one[:, 0] - one[0, 0] for one in flights])
    x_m, y_m = turn @ (np.concatenate([one[:, 1:3] for one in flights]) - begin_m).T
    shot = np.repeat(np.arange(len(flights)), [len(one) for one in flights])
    return Tracks(shot, t_s, x_m, y_m, np.concatenate([one[:, 3] for one in flights]))
