"""Importers of ball drops: filmed drops from 47 m (de Silva et al. 2020) and timed ones (SEPIA's tutorial, lanl/SEPIA).

proof/IMPORTERS.md describes the columns, their origin, and the assumptions.
"""

import io
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import openpyxl

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Air, Ball, Believe, LauncherFacts, Noise, Rig
from truearc.sim.data.dataset import Dataset, Shots, Times
from truearc.sim.data.table import (
    Cell,
    Problems,
    RawTable,
    gathered,
    load_table,
    need_columns,
    number_column,
    parse_number,
    text_column,
    text_of,
)
from truearc_proof.importers.originals import group_rows, part, tracks_of

COLUMNS = ("ball", "drop", "t_s", "height_m", "mass_kg", "diameter_m")
BODY = ("mass_kg", "diameter_m")      # of a ball: the same in each of its rows, empty if not measured
TRACK_NOISE_M = 0.07                  # scatter of the heights about a smooth fall (degree 4), all 22 drops together
RELEASE_HEIGHT_M = 47.16              # where the published drops begin, in the middle; each track says its own
SHORTEST = 8                          # samples that a drop needs
SHEET_COLUMNS = {"drop": "Drop #", "t_s": "Time (s)", "height_m": "Height (m)"}     # ours -> theirs
OUNCE_KG = 0.0283495
CM_M = 0.01
UNKNOWN = "??"                        # not measured
# sheets whose ball has another name in the list; else it is the sheet's in one word, with "wiffle" for "whiffle"
LISTED_AS = {"Yellow Whiffle Ball": "yellowWiffle", "Orange Whiffle Ball": "orangeWiffle"}
Body = tuple[Cell, Cell]              # mass_kg, diameter_m
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


def import_ball_drops(*files: str | Path) -> Dataset:
    """Read one CSV file, or the workbook and the list of balls; one shot per drop, with all samples.

    InputError names file, line and column of each bad row.

    Frame: the fall is taken as vertical, x = y = 0, z up from the ground. `t_s` counts from each drop's first sample.
    Each ball's own mass and radius are columns of the shots; rig.toml's ball is a typical one.
    """
    with gathered() as problems:
        drops, *balls = map(Path, files)
        tables = load_sheets(drops, balls[0], problems) if balls else [load_table(drops, problems)]
        found = [drop for table in tables for drop in _drops(table, problems)]
    kept = [drop for drop in found if len(drop.samples) >= SHORTEST]
    left_out = tuple(f"{drop.name}: fewer than {SHORTEST} samples" for drop in found if len(drop.samples) < SHORTEST)
    if not any(math.isfinite(drop.area_per_mass_m2_kg) for drop in kept):
        raise InputError(f"{files[0]}: no drop of {SHORTEST} samples has a ball of known mass_kg and diameter_m")
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


def load_sheets(workbook: Path, balls: Path, problems: Problems) -> list[RawTable]:
    """Return a table for each ball; lines are the sheet's rows, from 1. InputError names an invalid file, sheet or
    line."""
    bodies = _listed_bodies(balls, problems)
    problems.close()
    return [_sheet(part(workbook, f"sheet {sheet.title}"), sheet, bodies, balls)
            for sheet in _opened(workbook).worksheets]


def _opened(workbook: Path) -> Any:
    """The public file is named .xls and holds a workbook of the newer kind: its content decides, not its name."""
    try:
        return openpyxl.load_workbook(io.BytesIO(workbook.read_bytes()), data_only=True)
    except OSError as error:
        raise InputError(f"{workbook}: {error.strerror or error}") from error
    except Exception as error:        # what openpyxl meets in a damaged workbook is of many kinds
        raise InputError(f"{workbook}: not a readable Excel workbook (.xlsx by content): {error}") from error


def _sheet(here: Path, sheet: Any, bodies: dict[str, Body], balls: Path) -> RawTable:
    ball = LISTED_AS.get(sheet.title, sheet.title.lower().replace(" ", "").replace("whiffle", "wiffle"))
    if ball not in bodies:
        raise InputError(f"{here}: its ball, {ball}, is not in {balls}")
    header, *rows = list(sheet.iter_rows()) or [()]
    names = [str(cell.value).strip() for cell in header]
    for name in SHEET_COLUMNS.values():
        if names.count(name) != 1:
            raise InputError(f"{here}:1: column {name!r} " + ("stands twice" if name in names else "is missing"))
    place = {ours: names.index(theirs) for ours, theirs in SHEET_COLUMNS.items()}
    read = {line: {ours: _cell(row[at]) for ours, at in place.items()} for line, row in enumerate(rows, start=2)}
    kept = [line for line, cells in read.items() if any(cell is not None for cell in cells.values())]
    columns: dict[str, list[Cell]] = {ours: [read[line][ours] for line in kept] for ours in SHEET_COLUMNS}
    mass_kg, diameter_m = bodies[ball]
    columns |= {"ball": [ball] * len(kept), "mass_kg": [mass_kg] * len(kept), "diameter_m": [diameter_m] * len(kept)}
    columns["drop"] = [f"{cell:g}" if isinstance(cell, float) else cell for cell in columns["drop"]]
    return RawTable(here, columns, kept)


def _cell(cell: Any) -> Cell:
    """A number, or the text of what is none; an empty cell is missing."""
    if cell.data_type == "n" and cell.value is not None:
        return float(cell.value)
    odd = {"e": "an error", "b": "a yes or no", "d": "a date"}
    return odd.get(cell.data_type, str(cell.value or "").strip()) or None


def _listed_bodies(path: Path, problems: Problems) -> dict[str, Body]:
    """Mass and diameter of each ball, out of lines `name ounces girth_cm` under a header."""
    bodies: dict[str, Body] = {}
    for line, text in enumerate(text_of(path).splitlines(), start=1):
        words = text.split()
        if line == 1 or not words:
            continue
        if len(words) != 3:
            problems.add(f"{path}:{line}", "", "is not a ball's name, weight (oz) and circumference (cm)")
        elif words[0] in bodies:
            problems.add(f"{path}:{line}", "", f"{words[0]!r} stands twice")
        else:
            bodies[words[0]] = (_scaled(words[1], OUNCE_KG, f"{path}:{line}", problems),
                                _scaled(words[2], CM_M / math.pi, f"{path}:{line}", problems))
    return bodies


def _scaled(word: str, factor: float, place: str, problems: Problems) -> Cell:
    number = None if word == UNKNOWN else parse_number(word)
    if word != UNKNOWN and (number is None or not math.isfinite(number)):
        problems.add(place, "", f"{word!r} is not a finite number, nor {UNKNOWN!r} for unknown")
    return None if number is None else number * factor


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
