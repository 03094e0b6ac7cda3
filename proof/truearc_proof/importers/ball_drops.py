"""Importers of ball drops: filmed drops from 47 m (de Silva et al. 2020) and timed ones (SEPIA's tutorial, lanl/SEPIA).

proof/IMPORTERS.md describes the columns, their origin, and the assumptions.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Air, Ball, Believe, LauncherFacts, Noise, Rig
from truearc.sim.data.dataset import Dataset, Shots, Times
from truearc.sim.data.table import Problems, RawTable, gathered, load_table, need_columns, number_column, text_column
from truearc_proof.importers.originals import group_rows, tracks_of

COLUMNS = ("ball", "drop", "t_s", "height_m", "mass_kg", "diameter_m")
BODY = ("mass_kg", "diameter_m")      # of a ball: the same in each of its rows, empty if not measured
TRACK_NOISE_M = 0.07                  # scatter of the heights about a smooth fall (degree 4), all 22 drops together
RELEASE_HEIGHT_M = 47.16              # where the published drops begin, in the middle; each track says its own
SHORTEST = 8                          # samples that a drop needs
DENSITY_KG_M3 = 12.0                  # of the balls of the first tutorial, which states none: like foam
AIR_KG_M3 = 1.2                       # there, too
SIGMA_S = 0.02                        # of its times, which have none: a good stopwatch
QUANTITIES = ("radius", "density of the air", "density of the ball", "height", "time", "standard deviation of the time")


@dataclass(frozen=True)
class _Drop:
    ball: str
    number: str                       # the first or the second time that this ball was dropped
    mass_kg: float                    # nan = unknown
    diameter_m: float
    samples: np.ndarray               # [k, 2]: t_s height_m

    @property
    def name(self) -> str:
        return f"{self.ball}-{self.number}"

    @property
    def radius_m(self) -> float:
        return 0.5 * self.diameter_m

    @property
    def track(self) -> np.ndarray:    # [k, 4]: t_s from the first sample, x_m y_m z_m
        t_s, z_m = self.samples.T
        return np.column_stack([t_s - t_s[0], np.zeros_like(z_m), np.zeros_like(z_m), z_m])

    @property
    def area_per_mass_m2_kg(self) -> float:
        return math.pi * self.radius_m**2 / self.mass_kg


def import_ball_drops(table: str | Path) -> Dataset:
    """Import one shot per drop, with all samples.

    InputError names file, line and column of each bad row.

    Frame: the fall is taken as vertical, x = y = 0, z up from the ground. `t_s` counts from each drop's first sample.
    Each ball's own mass and radius are columns of the shots; rig.toml's ball is a typical one.
    """
    with gathered() as problems:
        found = _drops(load_table(Path(table), problems), problems)
    kept = [drop for drop in found if len(drop.samples) >= SHORTEST]
    left_out = tuple(f"{drop.name}: fewer than {SHORTEST} samples" for drop in found if len(drop.samples) < SHORTEST)
    if not any(math.isfinite(drop.area_per_mass_m2_kg) for drop in kept):
        raise InputError(f"{table}: no drop of {SHORTEST} samples has a ball of known mass_kg and diameter_m")
    # rig.toml's ball: that of the median cross-section per mass (the lower of two), which the air slows as it does most
    weighed = sorted((drop for drop in kept if math.isfinite(drop.area_per_mass_m2_kg)),
                     key=lambda drop: drop.area_per_mass_m2_kg)
    middle = weighed[(len(weighed) - 1) // 2]
    rig = Rig(ball=Ball(middle.mass_kg, middle.radius_m), launcher=LauncherFacts(release_height_m=RELEASE_HEIGHT_M),
              air=Air(1.2), noise=Noise(track_m=TRACK_NOISE_M), believe=Believe(("gravity", "drag")))
    columns = {name: np.array([getattr(drop, name) for drop in kept])
               for name in ("mass_kg", "radius_m", "area_per_mass_m2_kg")}
    shots = Shots(tuple(drop.name for drop in kept), columns, {
        "session": tuple(f"drop {drop.number}" for drop in kept), "ball_id": tuple(drop.ball for drop in kept)})
    return Dataset("ball-drops", rig, shots, tracks_of([drop.track for drop in kept]), None, left_out)


def _drops(table: RawTable, problems: Problems) -> list[_Drop]:
    """The drops in the order of their first rows."""
    need_columns(table, COLUMNS)
    ball, number = text_column(table, "ball", problems), text_column(table, "drop", problems)
    samples = np.stack([number_column(table, name, problems) for name in ("t_s", "height_m")], axis=1)
    body = _bodies(table, ball, problems)
    keys = list(zip(ball, number, strict=True))
    rows_of = group_rows(keys, samples[:, 0], table, problems, "drop")
    return [_Drop(name, times, float(body[rows[0], 0]), float(body[rows[0], 1]), samples[rows])
            for (name, times), rows in rows_of.items()]


def _bodies(table: RawTable, ball: tuple[str, ...], problems: Problems) -> np.ndarray:
    """[rows, 2]: mass and diameter of each row's ball, above 0 or nan, one of each a ball."""
    body = np.stack([number_column(table, name, problems, needed=False) for name in BODY], axis=1)
    first = {name: row for row, name in reversed(list(enumerate(ball)))}
    for row, name in enumerate(ball):
        for column, value, before in zip(BODY, body[row], body[first[name]], strict=True):
            if value <= 0.0:
                problems.add(table.place(row), column, f"{value:g} must be above 0")
            if not np.array_equal(value, before, equal_nan=True):
                problems.add(table.place(row), column, f"{name!r} has another in {table.place(first[name])}")
    return body


def import_sepia_drops(*files: str | Path) -> Dataset:
    """Read a table of drops, or the three files of the tutorial: times, heights, radii.

    One shot per drop, from rest, of a ball with its own mass_kg and radius_m. Every ball fell to the floor; all start
    at the greatest drop height, and each time's height is measured above the floor.

    Raises:
        InputError: names file and line of an invalid number, or files whose sizes do not match.
    """
    paths = [Path(file) for file in files]
    drops = _sepia_table(paths[0]) if len(paths) == 1 else _tutorial(*paths)
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


def _sepia_table(path: Path) -> np.ndarray:
    """[drops, 6] of QUANTITIES."""
    drops = _numbers(path)
    if drops.shape[1] != len(QUANTITIES):
        raise InputError(f"{path}: has {drops.shape[1]} columns; {len(QUANTITIES)} are needed: {', '.join(QUANTITIES)}")
    _check_above_0(path, drops)
    if np.ptp(drops[:, 1]) > 0.0:
        raise InputError(f"{path}: {QUANTITIES[1]}: differs from drop to drop; truearc has one air a dataset")
    return drops


def _tutorial(times: Path, heights: Path, radii: Path) -> np.ndarray:
    """[drops, 6] of QUANTITIES, of a table of times with a row a radius and a column a height."""
    t_s, height_m, radius_m = _numbers(times), _numbers(heights).ravel(), _numbers(radii).ravel()
    if t_s.shape != (len(radius_m), len(height_m)):
        raise InputError(f"{times}: has {t_s.shape[0]} rows of {t_s.shape[1]}; {radii} has {len(radius_m)} radii and "
                         f"{heights} {len(height_m)} heights")
    drops = np.array([(radius, AIR_KG_M3, DENSITY_KG_M3, height, t_s[row, column], SIGMA_S)
                      for row, radius in enumerate(radius_m) for column, height in enumerate(height_m)])
    _check_above_0(times, drops)
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


def _check_above_0(path: Path, drops: np.ndarray) -> None:
    for name, column in zip(QUANTITIES, drops.T, strict=True):
        if not (np.isfinite(column) & (column > 0.0)).all():
            row = int(np.flatnonzero(~(np.isfinite(column) & (column > 0.0)))[0])
            raise InputError(f"{path}: drop {row + 1}: {name}: {column[row]:g} must be above 0")
