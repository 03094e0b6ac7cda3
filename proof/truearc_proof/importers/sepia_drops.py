"""Drops of the SEPIA calibration toolbox (lanl/SEPIA, examples/Ball_Drop) -> dataset with times at heights.

proof/IMPORTERS.md says what the files hold, where they come from, and what is assumed.
"""

import math
from pathlib import Path

import numpy as np

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Air, Ball, Believe, LauncherFacts, Rig
from truearc.sim.data.dataset import Dataset, Shots, Times

DENSITY_KG_M3 = 12.0                  # of the balls of the first tutorial, which states none: like foam
AIR_KG_M3 = 1.2                       # there, too
SIGMA_S = 0.02                        # of its times, which have none: a good stopwatch
COLUMNS = ("radius", "density of the air", "density of the ball", "height", "time", "standard deviation of the time")


def import_sepia_drops(*files: str | Path) -> Dataset:
    """Read a table of drops, or the three files of the tutorial: times, heights, radii.

    One shot a drop, from rest, of a ball with its own mass_kg and radius_m. Every ball fell to the floor; all are put
    where the highest was dropped, with the height at which each was timed above the floor.

    Raises:
        InputError: names file and line of what is not a number or cannot be, or files whose sizes do not match.
    """
    paths = [Path(file) for file in files]
    drops = _table(paths[0]) if len(paths) == 1 else _tutorial(*paths)
    radius_m, air, density, fallen_m, t_s, sigma_s = drops.T
    mass_kg = density * 4.0 / 3.0 * math.pi * radius_m**3
    top_m = float(fallen_m.max())
    ids = tuple(f"drop{number:02d}" for number in range(1, len(drops) + 1))
    balls = {each: f"ball{number}" for number, each in enumerate(dict.fromkeys(zip(radius_m, mass_kg, strict=True)), 1)}
    names = tuple(balls[each] for each in zip(radius_m, mass_kg, strict=True))
    middle = int(np.argsort(radius_m**2 / mass_kg, kind="stable")[(len(drops) - 1) // 2])
    rig = Rig(Ball(float(mass_kg[middle]), float(radius_m[middle])), LauncherFacts(release_height_m=top_m),
              air=Air(float(air[0])), believe=Believe(("gravity",)))
    shots = Shots(ids, {"mass_kg": mass_kg, "radius_m": radius_m}, {"ball_id": names})
    return Dataset("sepia-drops", rig, shots, times=Times(np.arange(len(drops)), t_s, top_m - fallen_m, sigma_s))


def _table(path: Path) -> np.ndarray:
    """[drops, 6] of COLUMNS."""
    drops = _numbers(path)
    if drops.shape[1] != len(COLUMNS):
        raise InputError(f"{path}: has {drops.shape[1]} columns; {len(COLUMNS)} are needed: {', '.join(COLUMNS)}")
    _check(path, drops)
    if np.ptp(drops[:, 1]) > 0.0:
        raise InputError(f"{path}: {COLUMNS[1]}: differs from drop to drop; truearc has one air a dataset")
    return drops


def _tutorial(times: Path, heights: Path, radii: Path) -> np.ndarray:
    """[drops, 6] of COLUMNS, of a table of times with a row a radius and a column a height."""
    t_s, height_m, radius_m = _numbers(times), _numbers(heights).ravel(), _numbers(radii).ravel()
    if t_s.shape != (len(radius_m), len(height_m)):
        raise InputError(f"{times}: has {t_s.shape[0]} rows of {t_s.shape[1]}; {radii} has {len(radius_m)} radii and "
                         f"{heights} {len(height_m)} heights")
    drops = np.array([(radius, AIR_KG_M3, DENSITY_KG_M3, height, t_s[row, column], SIGMA_S)
                      for row, radius in enumerate(radius_m) for column, height in enumerate(height_m)])
    _check(times, drops)
    return drops


def _numbers(path: Path) -> np.ndarray:
    """The file's numbers, a row a line; # and % begin comments."""
    rows: list[list[float]] = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        cells = line.partition("#")[0].partition("%")[0].split()
        try:
            row = [float(cell) for cell in cells]
        except ValueError as error:
            raise InputError(f"{path}:{number}: {error}") from error
        if row and rows and len(row) != len(rows[0]):
            raise InputError(f"{path}:{number}: has {len(row)} numbers, the lines before have {len(rows[0])}")
        rows += [row] if row else []
    if not rows:
        raise InputError(f"{path}: has no numbers")
    return np.array(rows)


def _check(path: Path, drops: np.ndarray) -> None:
    for name, column in zip(COLUMNS, drops.T, strict=True):
        if not (np.isfinite(column) & (column > 0.0)).all():
            row = int(np.flatnonzero(~(np.isfinite(column) & (column > 0.0)))[0])
            raise InputError(f"{path}: drop {row + 1}: {name}: {column[row]:g} must be above 0")
