"""Balls dropped from 47 m and filmed (de Silva et al. 2020, "Discovery of physics from data") -> dataset.

proof/IMPORTERS.md says what the columns are, where they come from, and what is assumed.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Air, Ball, Believe, LauncherFacts, Noise, Rig
from truearc.sim.data.columns import need_columns, number_column, text_column
from truearc.sim.data.dataset import Dataset, Shots, Tracks
from truearc.sim.data.table import Problems, RawTable, gathered, load_table
from truearc_proof.importers.ball_sheets import load_sheets

COLUMNS = ("ball", "drop", "t_s", "height_m", "mass_kg", "diameter_m")
BODY = ("mass_kg", "diameter_m")      # of a ball: the same in each of its rows, empty if not measured
TRACK_NOISE_M = 0.07                  # scatter of the heights about a smooth fall (degree 4), all 22 drops together
RELEASE_HEIGHT_M = 47.16              # where the published drops begin, in the middle; each track says its own
SHORTEST = 8                          # samples that a drop needs


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
    def area_per_mass_m2_kg(self) -> float:
        return math.pi * self.radius_m**2 / self.mass_kg


def import_ball_drops(*files: str | Path) -> Dataset:
    """Read one CSV file, or the workbook and the list of balls; one shot a drop, all samples kept.

    InputError names file, line and column of each bad row.

    Frame: the fall is taken as vertical, x = y = 0, z up from the ground. `t_s` counts from each drop's first sample.
    Each ball's own mass and radius are columns of the shots; rig.toml's ball is a typical one (`_typical`).
    """
    with gathered() as problems:
        found = [drop for table in _tables(*map(Path, files), problems=problems) for drop in _drops(table, problems)]
    kept = [drop for drop in found if len(drop.samples) >= SHORTEST]
    left_out = tuple(f"{drop.name}: fewer than {SHORTEST} samples" for drop in found if len(drop.samples) < SHORTEST)
    if not any(math.isfinite(drop.area_per_mass_m2_kg) for drop in kept):
        raise InputError(f"{files[0]}: no drop of {SHORTEST} samples has a ball of known mass_kg and diameter_m")
    return Dataset("ball-drops", _rig(kept), _shots(kept), _tracks(kept), None, left_out)


def _tables(drops: Path, balls: Path | None = None, *, problems: Problems) -> list[RawTable]:
    """A workbook's sheets, where there is a list of balls beside it; else a table of all drops."""
    return [load_table(drops, problems)] if balls is None else load_sheets(drops, balls, problems)


def _drops(table: RawTable, problems: Problems) -> list[_Drop]:
    """The drops in the order of their first rows."""
    need_columns(table, COLUMNS)
    ball, number = text_column(table, "ball", problems), text_column(table, "drop", problems)
    samples = np.stack([number_column(table, name, problems) for name in ("t_s", "height_m")], axis=1)
    body = _bodies(table, ball, problems)
    rows_of: dict[tuple[str, str], list[int]] = {}
    for row, key in enumerate(zip(ball, number, strict=True)):
        rows = rows_of.setdefault(key, [])
        if rows and samples[row, 0] <= samples[rows[-1], 0]:
            problems.add(table.place(row), "t_s", "does not follow the sample before of the same drop")
        rows.append(row)
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


def _shots(drops: list[_Drop]) -> Shots:
    columns = {name: np.array([getattr(drop, name) for drop in drops])
               for name in ("mass_kg", "radius_m", "area_per_mass_m2_kg")}
    return Shots(tuple(drop.name for drop in drops), columns,
                 {"session": tuple(f"drop {drop.number}" for drop in drops),
                  "ball_id": tuple(drop.ball for drop in drops)})


def _tracks(drops: list[_Drop]) -> Tracks:
    shot = np.repeat(np.arange(len(drops)), [len(drop.samples) for drop in drops])
    t_s = np.concatenate([drop.samples[:, 0] - drop.samples[0, 0] for drop in drops])
    z_m = np.concatenate([drop.samples[:, 1] for drop in drops])
    return Tracks(shot, t_s, np.zeros_like(z_m), np.zeros_like(z_m), z_m)


def _typical(drops: list[_Drop]) -> Ball:
    """The ball whose cross-section per mass is the median one (the lower of two): the air slows it as it does most."""
    weighed = sorted((drop for drop in drops if math.isfinite(drop.area_per_mass_m2_kg)),
                     key=lambda drop: drop.area_per_mass_m2_kg)
    middle = weighed[(len(weighed) - 1) // 2]
    return Ball(middle.mass_kg, middle.radius_m)


def _rig(drops: list[_Drop]) -> Rig:
    return Rig(ball=_typical(drops), launcher=LauncherFacts(release_height_m=RELEASE_HEIGHT_M), air=Air(1.2),
                 noise=Noise(track_m=TRACK_NOISE_M), believe=Believe(("gravity", "drag")))
