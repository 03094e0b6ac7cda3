"""Two tables of set points beside each other: where they differ, and by how many points, by a belief."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from truearc.errors import InputError
from truearc.robot.config.rig_spec import Rig
from truearc.sim.aim.read_snippets import read_java, read_json
from truearc.sim.aim.snippets import RPM
from truearc.sim.aim.solve import chances_of
from truearc.sim.data.columns import RANGES, in_read_units, parse_number
from truearc.sim.data.table import Problems, RawTable, gathered, parse_csv, text_of
from truearc.sim.infer.belief import Belief
from truearc.sim.printed import Printed, make_text

READ = ("distance_m", "hood_deg", "motor_ratio", "motor_rad_s")
ALIASES = {"hood_angle_deg": "hood_deg", "velocity_rps": "motor_rps"}      # as team 2928's files have them
SAME = 1e-6                           # m, between distances that are one
ROUNDED = 1.001                       # of the free speed: a converted unit is not beyond it
HEADER = ("m", "hood deg, old", "new", "motor rpm, old", "new", "points, old", "new", "gained")
Rows = Float[np.ndarray, " n"]


@dataclass(frozen=True, eq=False)
class SetPoints(Printed):
    """A table by ascending distance [n], as a robot interpolates it: straight between the rows. `name`: for messages.
    """

    name: str
    distance_m: Rows
    hood_deg: Rows
    motor_ratio: Rows

    def lines(self) -> list[str]:
        """Return a line per distance: hood angle and motor speed over free speed."""
        rows = zip(self.distance_m, self.hood_deg, self.motor_ratio, strict=True)
        return make_text(("m", "hood deg", "motor ratio"), [(f"{x:.2f}", f"{hood:.1f}", f"{ratio:.3f}")
                                                           for x, hood, ratio in rows], right=(0, 1, 2))

    def at(self, distance_m: Rows) -> tuple[Rows, Rows]:
        """(hood in degrees, motor speed over free speed) at other distances, between the ends."""
        return (np.interp(distance_m, self.distance_m, self.hood_deg),
                np.interp(distance_m, self.distance_m, self.motor_ratio))


@dataclass(frozen=True, eq=False)
class Comparison(Printed):
    """Of two tables at every distance that either has and both span [n]; points a ball by a belief."""

    old: SetPoints
    new: SetPoints
    distance_m: Rows
    old_points: Rows
    new_points: Rows
    free_rad_s: float

    @property
    def gained(self) -> Rows:
        """Points that a ball gains by the new table [n]."""
        gained: Rows = self.new_points - self.old_points
        return gained

    def lines(self) -> list[str]:
        """Return what the new table gains, where most, and a line per distance."""
        gained = self.gained
        most = int(np.argmax(np.abs(gained)))
        said = (f"{self.new.name} scores {np.mean(gained):+.2f} points a ball compared with {self.old.name}, the mean "
                f"of {len(gained)} distances from {self.distance_m[0]:.2f} to {self.distance_m[-1]:.2f} m; most at "
                f"{self.distance_m[most]:.2f} m: {gained[most]:+.2f}")
        settings = [(*self.old.at(np.array([x])), *self.new.at(np.array([x]))) for x in self.distance_m]
        rows = [(f"{x:.2f}", f"{one[0][0]:.1f}", f"{one[2][0]:.1f}", f"{one[1][0] * self.free_rad_s * RPM:.0f}",
                 f"{one[3][0] * self.free_rad_s * RPM:.0f}", f"{before:.2f}", f"{after:.2f}", f"{after - before:+.2f}")
                for x, one, before, after in zip(self.distance_m, settings, self.old_points, self.new_points,
                                                 strict=True)]
        return [said, "", *make_text(HEADER, rows, right=range(len(HEADER)))]


def load_set_points(path: str | Path, rig: Rig) -> SetPoints:
    """Read a table of set points: CSV with `distance_m`, `hood_deg` and `motor_ratio` or `motor_rad_s` (or in other
    units: `distance_ft`, `motor_rpm`, ...), or JSON or Java as `truearc aim` writes them.

    Args:
        path: The file.
        rig: Whose motors' free speed turns speeds into ratios.

    Raises:
        InputError: names file, line and column of what is missing, wrong, or beyond what a launcher can do; the rig has
            no free speed.
    """
    path = Path(path)
    free_rad_s = rig.launcher.free_speed_rad_s
    if not free_rad_s:
        raise InputError(f"{path}: rig.toml has no launcher.free_speed_rad_s, which turns motor speeds into ratios")
    with gathered() as problems:
        raw = _read(path, problems)
        raw = RawTable(path, {ALIASES.get(name, name): cells for name, cells in raw.columns.items()}, raw.lines)
        ratios = "motor_ratio" in {"_".join(name.lower().split()) for name in raw.columns}
        table = in_read_units(raw, lambda name: name in READ and (ratios or name != "motor_ratio"), problems)
        speed = next((name for name in READ[2:] if name in table.columns), READ[2])
        most = {**RANGES, "motor_ratio": (0.0, ROUNDED), "motor_rad_s": (0.0, ROUNDED * free_rad_s)}
        columns = {name: _numbers(table, name, most[name], problems) for name in (*READ[:2], speed)}
        if not problems and len(columns["distance_m"]) == 0:
            problems.add(str(path), "", "has no set point")
    order = np.argsort(columns["distance_m"], kind="stable")
    distance_m, hood_deg, motor = (columns[name][order] for name in (*READ[:2], speed))
    if (np.diff(distance_m) <= 0.0).any():
        raise InputError(f"{path}: a distance stands twice")
    return SetPoints(str(path), distance_m, hood_deg, motor if speed == "motor_ratio" else motor / free_rad_s)


def _read(path: Path, problems: Problems) -> RawTable:
    text = text_of(path)
    if path.suffix.lower() in (".json", ".json-3476"):
        return read_json(text, path, READ)
    if path.suffix.lower().startswith(".java"):
        return read_java(text, path)
    return parse_csv(text, path, problems)


def _numbers(table: RawTable, name: str, limits: tuple[float, float], problems: Problems) -> Rows:
    if name not in table.columns:
        problems.add(table.place(-1), name, "is missing")
        return np.zeros(0)
    numbers = [parse_number(cell) for cell in table.columns[name]]
    for row, number in enumerate(numbers):
        if number is None or not np.isfinite(number):
            table.fault(problems, row, name, f"{table.columns[name][row]!r} is not a number")
        elif not limits[0] <= number <= limits[1]:
            low, high = (table.shown(name, limit) for limit in limits)
            table.fault(problems, row, name, f"{table.shown(name, number)} is not between {low} and {high}")
    return np.array([np.nan if number is None else number for number in numbers])


def compare(old: SetPoints, new: SetPoints, belief: Belief, rig: Rig) -> Comparison:
    """Compare two tables by a belief: expected points of the rig's balls at each distance of either.

    Args:
        old: Table, as load_set_points reads it.
        new: Another.
        belief: Coefficients, scatter and covariance, by which points are forecast.
        rig: Launcher, target and sensor noise.

    Raises:
        InputError: the tables have no distance in common, or the rig has no target.
    """
    low, high = (pick(one.distance_m[end] for one in (old, new)) for pick, end in ((max, 0), (min, -1)))
    both = np.unique(np.concatenate([old.distance_m, new.distance_m]))
    both = both[(both >= low - SAME) & (both <= high + SAME)]
    both = both[np.append(True, np.diff(both) > SAME)] if len(both) else both
    if not len(both):
        raise InputError(f"{new.name}: from {new.distance_m[0]:g} to {new.distance_m[-1]:g} m; {old.name} from "
                         f"{old.distance_m[0]:g} to {old.distance_m[-1]:g} m: no distance in common")
    points: Sequence[Rows] = [chances_of(rig, belief, both, *one.at(both)).points for one in (old, new)]
    return Comparison(old, new, both, points[0], points[1], rig.launcher.free_speed_rad_s or 0.0)
