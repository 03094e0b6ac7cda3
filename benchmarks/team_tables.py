"""Teams' own set points: fitted from half of the rows, judged on the other half, beside linear interpolation.

    python -m benchmarks.team_tables FILE [--teams 254 971 ...] [--every] [--step 2] [--rows]

FILE is a CSV of set points: team, table, distance_m, wheel_rpm, hood_raw, wheel2_rpm, note. Of each team the table with
the most rows is taken (--every: all tables); where a hood has a few positions only, each of them is a table. Rows that
the team did not tune (extrapolated or interpolated, by the note) are left out. Every second row (--step) is fitted
and the rows between are judged; then the other way round.

A set point is taken as a shot through the centre of the goal. Wheel size, zero of the hood and the point from which
distances count are stated for hardly any robot, so each is fitted with a wide prior (below), with drag, lift and slip.
Where the hood's zero is not known, the fit starts from three, and the most probable of the three fits is used.
Judged: `truearc aim` at the row's distance and the team's hood angle there, by its wheel speed; and the hood angle that
reaches the centre at the team's wheel speed. Interpolation knows the distance alone, and beyond the fitted rows keeps
the last value, as InterpolatingTreeMap does. A regression (straight in distance and hood) has what the belief has.
"""

import argparse
import csv
import math
import sys
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

import truearc as ta
from truearc.api.terms import joined, names_of
from truearc.cli.common import make_progress
from truearc.robot.config.rig_spec import Air, Ball, LauncherFacts, Noise, Rig, Target, Wheel
from truearc.sim.compile_cache import keep_compiled
from truearc.sim.infer.fit import MapFit, fit_map
from truearc.sim.infer.plausibility.check import needed_speed
from truearc.sim.physics.term import (
    ANGLE,
    LENGTH,
    SHARE,
    DistanceTerm,
    Exit,
    HoodTerm,
    Instrument,
    Number,
    SensingTerm,
    Values,
    amplitude,
    either_way,
)
from truearc.sim.tables import make_text

Array = np.ndarray
RPM = 2.0 * math.pi / 60.0
FEWEST = 5                            # rows of a table
WHEEL_M, FREE_RAD_S = 0.0508, 1200.0  # assumed; a team's speeds are scaled to this wheel (scale_of)
RELEASE_M = 0.75                      # assumed
TUNED = Noise(distance_m=0.05, hood_deg=0.5, wheel_rad_s=5.0)    # to what teams tune: about 1 % of speed; assumed
BEYOND_VACUUM = 1.3                   # exit speed over the least without air, as foam balls need it
GOAL_M, OPENING_M = 2.4956, (0.0762, 0.381)
MIDDLES_DEG = (45.0, 30.0, 60.0)      # assumed elevations of the middle fitted row, where the hood's zero is not known
GRAVITY_M_S2 = 9.81
ANGLES_DEG = np.arange(5.0, 85.25, 0.25)
HEADER = ("team", "rows", "belief %", "line %", "plane %", "beyond", "belief %", "line %", "plane %", "hood: belief",
          "line", "refused", "no hood")
ROW_HEADER = ("team", "table", "m", "", "rpm", "belief %", "line %", "plane %", "hood: belief deg", "line deg")
NOT_TUNED = ("EXTRAPOLATED", "interpolated")


class Hood(NamedTuple):
    """How a team's hood number becomes an elevation: sign (0: it stands still), degrees per unit, zero if known."""

    sign: float
    deg: float = 1.0
    zero_deg: float | None = None


FIXED = Hood(0.0)
HOODS = {"254": Hood(-1.0, zero_deg=90.0), "1678": Hood(-1.0), "2910": Hood(1.0, zero_deg=0.0),
         "3476": Hood(1.0), "5940": Hood(-1.0), "971": Hood(-1.0, math.degrees(1.0))}


class WheelSize(SensingTerm):
    """true surface speeds = the assumed ones x (1 + share), and with them exit speed and spin."""

    order = 31, "the wheels, which the hood has no part in"
    parameters = amplitude("share", "1", -0.7, 2.0, sd=0.3, meaning="surface speed above the assumed one",
                           source="wheels of 2 to 6 inches and gears of 1:1 to 1:2",
                           reason="neither the wheels' size nor their gear is stated")
    direction = "along"
    sentence = "The wheels are of another size or gear than assumed."
    phrase = either_way("the wheels' surfaces run {} <faster|slower> than assumed", SHARE)
    instrument = Instrument("calipers", "wheel diameter and gear", 0.01)

    def sense(self, rig: Rig, values: Values, exit: Exit, distance_m: Number) -> tuple[Exit, Number]:
        factor = 1.0 + values["share"]
        return exit._replace(speed_m_s=exit.speed_m_s * factor, spin_rev_s=exit.spin_rev_s * factor), distance_m


class HoodZero(HoodTerm):
    """true elevation = assumed + angle_deg."""

    order = 11, "sensors of the launch come first"
    parameters = amplitude("angle_deg", "deg", -40.0, 40.0, sd=10.0, meaning="true elevation less the assumed one",
                           source="a hood's number may count from anywhere",
                           reason="a hood that scores stands within 20 degrees of 45 at middle distance")
    sentence = "The hood's zero is another than assumed."
    phrase = either_way("the hood stands {} <steeper|flatter> than assumed", ANGLE)
    instrument = Instrument("inclinometer", "hood angle with an inclinometer", 0.2)


class Datum(DistanceTerm):
    """true distance = the team's + by_m."""

    order = 51, "distances after the launch"
    parameters = amplitude("by_m", "m", -1.0, 1.0, sd=0.15, meaning="distance from the exit less the team's",
                           source="a robot is 0.8 m long", reason="teams measure from camera, turret or robot centre")
    sentence = "Distances count from another point than the exit."
    phrase = either_way("the target is {} <farther|nearer> than the team's distance", LENGTH)
    instrument = Instrument("tape", "distance with a tape", 0.02)

    def distance_m(self, measured_m: Number, amount: Number) -> Number:
        return measured_m + amount


TERMS = ("gravity", "drag", "magnus", "wheel_slip", WheelSize(), HoodZero(), Datum())


class Points(NamedTuple):
    """A table, nearest first: arrays [n]; second: speed of the upper wheel by the lower one's, 0 for a still hood."""

    team: str
    name: str
    distance_m: Array
    rpm: Array
    hood: Array                       # the team's number, 0 where the hood stands still
    second: Array

    def take(self, rows: Array) -> "Points":
        return self._replace(**{name: getattr(self, name)[rows] for name in self._fields[2:]})


class Row(NamedTuple):
    """A judged row: relative errors of speed, and errors of the hood in degrees; NaN where there is none."""

    points: Points
    distance_m: float
    edge: bool                        # beyond the fitted rows
    rpm: float
    belief_rpm: float
    line_rpm: float
    plane_rpm: float
    belief_hood_deg: float
    line_hood_deg: float


def load_tables(path: str, every: bool) -> list[Points]:
    """Tables with enough rows, by team."""
    with open(path, encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if not any(word in row["note"] for word in NOT_TUNED)]
    tables: dict[tuple[str, str], dict[str, list[dict[str, str]]]] = {}
    for row in rows:
        position = "" if row["team"] in HOODS else row["hood_raw"]
        tables.setdefault((row["team"], row["table"]), {}).setdefault(position, []).append(row)
    parts = {key: [_points(key, position, ones) for position, ones in table.items() if len(ones) >= FEWEST]
             for key, table in tables.items()}
    counts = {key: sum(len(part.rpm) for part in ones) for key, ones in parts.items()}
    largest = {team: max((key for key in counts if key[0] == team), key=lambda key: counts[key])
               for team, _ in counts}
    return [part for key, ones in parts.items() if every or key == largest[key[0]] for part in ones]


def _points(key: tuple[str, str], position: str, rows: list[dict[str, str]]) -> Points:
    def column(name: str) -> Array:
        return np.array([float(row[name] or "0") for row in rows])

    distance_m, rpm = column("distance_m"), column("wheel_rpm")
    order = np.argsort(distance_m, kind="stable")
    moves = key[0] in HOODS
    two_wheels = not moves and not position
    return Points(key[0], " ".join(filter(None, (key[1], position))), distance_m[order], rpm[order],
                  (column("hood_raw") if moves else np.zeros(len(rows)))[order],
                  (column("wheel2_rpm") / rpm if two_wheels else np.zeros(len(rows)))[order])


def elevation_deg(points: Points, zero_deg: float) -> Array:
    hood = HOODS.get(points.team, FIXED)
    return zero_deg + hood.sign * hood.deg * points.hood


def rig_of(second: float = 0.0) -> Rig:
    """One wheel against a hood, or two wheels whose speeds have this ratio."""
    wheels = Wheel("main", WHEEL_M, 1.0, 180.0), Wheel("hood", WHEEL_M, second, 0.0)
    return Rig(Ball(0.142, 0.0889), LauncherFacts(RELEASE_M, FREE_RAD_S, wheels), Target(GOAL_M, *OPENING_M), Air(1.2),
               noise=TUNED)


def scale_of(known: Points, hood_deg: Array) -> float:
    """rad/s of the assumed wheel per rpm: the middle fitted row then leaves at BEYOND_VACUUM of the least speed."""
    least_m_s = needed_speed(known.distance_m, GOAL_M - RELEASE_M, hood_deg, GRAVITY_M_S2)
    return float(np.median(BEYOND_VACUUM * least_m_s / (WHEEL_M * known.rpm * (1.0 + known.second) / 2.0)))


def dataset_of(points: Points, hood_deg: Array, scale: float) -> ta.Dataset:
    n, wheel_rad_s = len(points.rpm), points.rpm * scale
    return ta.dataset({"shot_id": [str(k) for k in range(n)], "distance_m": points.distance_m, "hood_deg": hood_deg,
                       "wheel_main_rad_s": wheel_rad_s, "wheel_hood_rad_s": wheel_rad_s * points.second,
                       "miss_height_m": np.zeros(n)}, rig=rig_of(), name=f"{points.team} {points.name}")


def judge(points: Points, first: int, step: int = 2) -> list[Row]:
    """Fit the rows first, first + step, ... and judge the others."""
    fits = np.arange(len(points.rpm)) % step == first
    known, asked = points.take(np.flatnonzero(fits)), points.take(np.flatnonzero(~fits))
    zero_deg, scale, belief = best_fit(known)
    known_deg, hood_deg = elevation_deg(known, zero_deg), elevation_deg(asked, zero_deg)
    plane = _plane(known)
    low, high = known.distance_m[[0, -1]]
    moves = bool(np.ptp(points.hood))
    judged = []
    for row, distance_m in enumerate(asked.distance_m.tolist()):
        one, deg = asked.take(np.array([row])), float(hood_deg[row])
        line_rpm, line_deg = (float(np.interp(distance_m, known.distance_m, column)) for column in (
            known.rpm, known_deg))
        plane_rpm = float(np.array([1.0, distance_m, one.hood[0]]) @ plane)
        edge = not low <= distance_m <= high
        row_of = partial(Row, points, distance_m, edge, float(one.rpm[0]), speed_by(belief, one, deg) / scale, line_rpm)
        judged.append(row_of(plane_rpm, hood_by(belief, one, line_deg, scale) - deg, line_deg - deg) if moves else
                      row_of(math.nan, math.nan, math.nan))
    return judged


def best_fit(known: Points) -> tuple[float, float, ta.Belief | None]:
    """(assumed zero of the hood, scale, belief) of the most probable fit; None where none settles."""
    zero_deg = HOODS.get(known.team, FIXED).zero_deg
    middle_deg = float(np.median(elevation_deg(known, 0.0)))
    zeros = [one - middle_deg for one in MIDDLES_DEG] if zero_deg is None else [zero_deg]
    scales = {zero: scale_of(known, elevation_deg(known, zero)) for zero in zeros}
    found = [(fitted(dataset_of(known, known_deg, scale)), zero, scale) for zero, scale in scales.items()
             for known_deg in [elevation_deg(known, zero)]
             if math.isfinite(scale) and known_deg.min() >= 0.0 and known_deg.max() <= 90.0]
    settled = [one for one in found if one[0].converged]
    if not settled:
        return zeros[0], scales[zeros[0]], None
    fit, zero, scale = max(settled, key=lambda one: one[0].log_posterior)
    return zero, scale, fit.belief


def fitted(dataset: ta.Dataset) -> MapFit:
    """The fit of ta.fit(dataset, TERMS), without its intervals and hold-out, which take ten times as long."""
    among = joined(TERMS)
    return fit_map(dataset, names_of(TERMS, "terms", among) or (), among=among)


def speed_by(belief: ta.Belief | None, one: Points, hood_deg: float) -> float:
    """The assumed wheel's rad/s of aim's set point for one row, with that hood angle; NaN where aim refuses."""
    if belief is None:
        return math.nan
    rig, distance_m = rig_of(float(one.second[0])), one.distance_m.tolist()
    try:
        return ta.aim(belief, rig, distances_m=distance_m, hood_deg=(hood_deg, hood_deg)).rows[0].motor_rad_s
    except ta.InputError:
        return math.nan


def hood_by(belief: ta.Belief | None, one: Points, near_deg: float, scale: float) -> float:
    """The elevation at which one row's speed meets the centre, of two the one nearer to near_deg; NaN: none does."""
    if belief is None:
        return math.nan
    told = ta.predict(dataset_of(one.take(np.zeros(len(ANGLES_DEG), int)), ANGLES_DEG, scale), belief)
    off_m = np.array([row[told.columns.index("deviation_m")] for row in told.rows], float)
    at = np.flatnonzero(off_m[:-1] * off_m[1:] <= 0.0)
    if not len(at):
        return math.nan
    share = off_m[at] / np.where(off_m[at] == off_m[at + 1], 1.0, off_m[at] - off_m[at + 1])
    roots = ANGLES_DEG[at] + share * (ANGLES_DEG[at + 1] - ANGLES_DEG[at])
    return float(roots[np.abs(roots - near_deg).argmin()])


def _plane(known: Points) -> Array:
    design = np.column_stack([np.ones_like(known.rpm), known.distance_m, known.hood])
    if len(known.rpm) < design.shape[1] + 1:
        return np.full(design.shape[1], np.nan)
    return np.linalg.lstsq(design, known.rpm, rcond=None)[0]


def rms(errors: Sequence[float]) -> float:
    known = np.array([error for error in errors if math.isfinite(error)])
    return float(np.sqrt((known**2).mean())) if len(known) else math.nan


def summary(rows: Sequence[Row]) -> list[float]:
    """RMS errors of speed in % of belief, line and regression, between the fitted rows and beyond; of the hood in
    degrees of belief and line, between them. Rows that the belief refuses count for none of them."""
    numbers = []
    for edge in (False, True):
        mine = [row for row in rows if row.edge == edge and math.isfinite(row.belief_rpm)]
        numbers += [rms([100.0 * (getattr(row, name) / row.rpm - 1.0) for row in mine])
                    for name in ("belief_rpm", "line_rpm", "plane_rpm")]
    both = [row for row in rows if not row.edge and math.isfinite(row.belief_hood_deg)]
    return numbers + [rms([getattr(row, name) for row in both]) for name in ("belief_hood_deg", "line_hood_deg")]


def report(rows: Sequence[Row]) -> list[str]:
    """A row per team, and how many teams each method is better for."""
    teams = {team: [row for row in rows if row.points.team == team] for team in
             dict.fromkeys(row.points.team for row in rows)}
    numbers = {team: summary(ones) for team, ones in teams.items()}
    text = []
    for team, ones in teams.items():
        cells = ["-" if math.isnan(one) else f"{one:.1f}" for one in numbers[team]]
        beyond = sum(row.edge for row in ones)
        text.append((team, str(len(ones) - beyond), *cells[:3], str(beyond), *cells[3:],
                     str(sum(math.isnan(row.belief_rpm) for row in ones)),
                     str(sum(math.isnan(row.belief_hood_deg) for row in ones if np.ptp(row.points.hood)))))
    lines = make_text(HEADER, text, right=range(1, len(HEADER)))
    for name, at in (("speed between the fitted rows", 0), ("speed beyond them", 3), ("hood between them", 6)):
        pairs = np.array([one[at:at + 2] for one in numbers.values()])
        pairs = pairs[np.isfinite(pairs).all(axis=1)]
        lines += [f"{name}: the belief is nearer for {(pairs[:, 0] < pairs[:, 1]).sum()} of {len(pairs)} teams; "
                  f"median over teams {middle[0]:.1f} (belief), {middle[1]:.1f} (line)"
                  for middle in [np.median(pairs, axis=0)] if len(pairs)]
    return lines


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", metavar="FILE")
    parser.add_argument("--teams", nargs="*", metavar="TEAM", help="these only")
    parser.add_argument("--every", action="store_true", help="all tables of each team")
    parser.add_argument("--step", type=int, default=2, metavar="N", help="fit every Nth row")
    parser.add_argument("--rows", action="store_true", help="print every judged row")
    args = parser.parse_args(argv)
    keep_compiled()
    tables = [one for one in load_tables(args.file, args.every)
              if (not args.teams or one.team in args.teams) and len(one.rpm) >= 2 * args.step]
    show, rows = make_progress("team_tables"), list[Row]()
    for number, table in enumerate(tables):
        rows += [row for first in range(args.step) for row in judge(table, first, args.step)]
        show((number + 1) / len(tables), f"{table.team} {table.name}")
    if args.rows:
        print("\n".join(make_text(ROW_HEADER, [row_text(row) for row in rows], right=range(2, len(ROW_HEADER)))))
    print("\n".join(report(rows)))
    return 0


def row_text(row: Row) -> tuple[str, ...]:
    errors = (100.0 * (one / row.rpm - 1.0) for one in (row.belief_rpm, row.line_rpm, row.plane_rpm))
    return (row.points.team, row.points.name, f"{row.distance_m:.2f}", "beyond" if row.edge else "", f"{row.rpm:.0f}",
            *("-" if math.isnan(one) else f"{one:+.1f}" for one in (*errors, row.belief_hood_deg, row.line_hood_deg)))


if __name__ == "__main__":
    sys.exit(main())
