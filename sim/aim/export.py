"""Set points for robots: the aim file, its check against the simulator, and lines to paste into robot code."""

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import msgspec
import numpy as np
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator

from truearc.errors import InputError
from truearc.robot.aim_file import SCHEMA, AimContent, AimFile, Curve, Motion, Segment, contract_hash, rig_of
from truearc.robot.config.rig_spec import Rig
from truearc.robot.gate import UNSEALED, seal
from truearc.sim.aim.make_table import RPM, AimRow
from truearc.sim.aim.on_the_move import on_the_move
from truearc.sim.aim.solve import chances_of, solve
from truearc.sim.infer.belief import Belief
from truearc.sim.printed import Printed

FLOWN, SET = ("distance_m", "hood_deg", "motor_ratio", "flight_s"), ("hood_deg", "motor_ratio", "lead_deg")
CHECKED = 40                          # distances at which a file is checked
MOST_LOST = 0.05                      # points that a set point of the file may fall short of the best by
Rows = Float[np.ndarray, " n"]
LEAST_LEAD_DEG = 0.05                 # what is less is left out
INCH_M = 0.0254


@dataclass(frozen=True, eq=False)
class AimCheck(Printed):
    """An aim file against the simulator, at distances [n] between its ends.

    points, best: expected points of the file's set points, and of those found again.
    """

    distance_m: Rows
    points: Rows
    best: Rows

    @property
    def lost(self) -> float:
        """Points by which the worst of the file's set points falls short."""
        return max(float(np.max(self.best - self.points)), 0.0)

    @property
    def passed(self) -> bool:
        return self.lost <= MOST_LOST

    def lines(self) -> list[str]:
        """Return how far the file's set points fall short of the best."""
        return [f"at {len(self.distance_m)} random distances at most {self.lost:.2f} points short of the best"]


def aim_bytes(rows: Sequence[AimRow], refused: Iterable[tuple[float, str]], rig: Rig, note: str,
              provenance: dict[str, Any], belief: Belief) -> bytes:
    """The sealed file; a distance without a set point parts it. InputError where no two neighbours are left."""
    gaps = [distance_m for distance_m, _ in refused]
    columns = [np.array([getattr(row, name) for row in rows]) for name in FLOWN]
    moving = np.column_stack(on_the_move(rig, belief, *columns))
    runs: list[list[int]] = [[0]]
    for number, (before, row) in enumerate(pairwise(rows), 1):
        if any(before.distance_m < gap < row.distance_m for gap in gaps):
            runs.append([])
        runs[-1].append(number)
    segments = tuple(_segment([rows[number] for number in run], moving[run]) for run in runs if len(run) > 1)
    if not segments:
        raise InputError("distances_m: no two neighbouring distances have a set point; an aim file needs them")
    content = AimContent(SCHEMA, UNSEALED, contract_hash(), note, rig_of(rig), segments, provenance)
    return seal(msgspec.json.format(msgspec.json.encode(content), indent=1) + b"\n")


def check_aim_file(aim: AimFile, belief: Belief, rig: Rig, seed: int = 0) -> AimCheck:
    """Solve for the best set points at random distances, within the file's hood angles, and compare."""
    segments = aim.content.segments
    spans = np.array([segment.distance_m[-1] - segment.distance_m[0] for segment in segments])
    rng = np.random.default_rng([seed, 41])
    chosen = rng.choice(len(segments), CHECKED, p=spans / spans.sum())
    distance_m = np.sort([segments[k].distance_m[0] + rng.uniform() * spans[k] for k in chosen])
    points = [point for point in map(aim.at, map(float, distance_m)) if point is not None]
    hood_deg, ratio = np.array([point.hood_deg for point in points]), np.array([point.motor_ratio for point in points])
    angles = [angle for segment in segments for angle in segment.hood_deg.value]
    best = solve(rig, belief, distance_m, (min(angles), max(angles))).chances
    return AimCheck(distance_m, chances_of(rig, belief, distance_m, hood_deg, ratio).points, best.points)


def _segment(rows: Sequence[AimRow], moving: Float[np.ndarray, "n 5"]) -> Segment:
    x = np.array([row.distance_m for row in rows])

    def curve(y: Rows) -> Curve:
        slope = PchipInterpolator(x, y).derivative()(x) if len(x) > 2 else np.full(2, (y[1] - y[0]) / (x[1] - x[0]))
        return Curve(tuple(map(float, y)), tuple(map(float, slope)))

    hood, ratio, lead = (curve(np.array([getattr(row, name) for row in rows])) for name in SET)
    known = np.flatnonzero(np.isfinite(moving).all(axis=1))
    if len(known) < 2 or np.ptp(known) != len(known) - 1:
        return Segment(tuple(map(float, x)), hood, ratio, lead)
    filled = moving[np.clip(np.arange(len(x)), known[0], known[-1])]
    carry, sideways, trim, bend, sink = map(curve, filled.T)
    return Segment(tuple(map(float, x)), hood, ratio, lead,
                   Motion(carry, sideways, trim, bend, sink, float(x[known[0]]), float(x[known[-1]])))


def has_lead(rows: Iterable[Any]) -> bool:
    """Whether a set point is aimed beside the target."""
    return any(abs(row.lead_deg) >= LEAST_LEAD_DEG for row in rows)


def _doubt(row: Any) -> list[str]:
    """A comment above a set point that the shots of the belief do not cover."""
    return [f"// {row.distance_m:.3f} m: {row.note}"] if row.note else []


def java_text(rows: Iterable[Any]) -> str:
    """Statements for two edu.wpi.first.math.interpolation.InterpolatingDoubleTreeMap, keyed by distance in m."""
    rows = tuple(rows)
    lead = has_lead(rows)
    lines = ["// by truearc aim: distance (m) -> hood (deg above the horizontal), motor (rpm)"
             + ", lead (deg to the left)" * lead]
    for row in rows:
        lines += [*_doubt(row), f"hoodDeg.put({row.distance_m:.3f}, {row.hood_deg:.2f});",
                  f"motorRpm.put({row.distance_m:.3f}, {row.motor_rad_s * RPM:.1f});"]
        lines += [f"leadDeg.put({row.distance_m:.3f}, {row.lead_deg:.2f});"] if lead else []
    return "\n".join(lines) + "\n"


def cpp_text(rows: Iterable[Any]) -> str:
    """An array that needs no library."""
    rows = tuple(rows)
    lead = has_lead(rows)
    lines = ["// by truearc aim: distance (m), hood (deg above the horizontal), motor (rpm)"
             + ", lead (deg to the left)" * lead, f"struct SetPoint {{ double distance_m, hood_deg, motor_rpm"
             f"{', lead_deg' * lead}; }};", "constexpr SetPoint kSetPoints[] = {"]
    for row in rows:
        lines += [*(f"    {line}" for line in _doubt(row)),
                  f"    {{{row.distance_m:.3f}, {row.hood_deg:.2f}, {row.motor_rad_s * RPM:.1f}"
                  + f", {row.lead_deg:.2f}" * lead + "},"]
    return "\n".join([*lines, "};"]) + "\n"


def java_6328_text(rows: Iterable[Any]) -> str:
    """Statements as in team 6328's ShotCalculator of 2026: hood in degrees from the vertical, motor in rad/s, time of
    flight in s, in InterpolatingTreeMap and InterpolatingDoubleTreeMap of WPILib."""
    lines = ["// by truearc aim: distance (m) -> hood (deg from the vertical), motor (rad/s), time of flight (s)"]
    for row in rows:
        at = f"{row.distance_m:.3f}"
        lines += [*_doubt(row), f"shotHoodAngleMap.put({at}, Rotation2d.fromDegrees({90.0 - row.hood_deg:.2f}));",
                  f"shotFlywheelSpeedMap.put({at}, {row.motor_rad_s:.2f});",
                  f"timeOfFlightMap.put({at}, {row.flight_s:.3f});"]
    return "\n".join(lines) + "\n"


def java_254_text(rows: Iterable[Any]) -> str:
    """Statements as in team 254's Constants of 2020: inches -> hood in degrees above the horizontal, motor in rpm."""
    lines = ["// by truearc aim: distance (in) -> hood (deg above the horizontal), motor (rpm)"]
    for row in rows:
        at = f"new InterpolatingDouble({row.distance_m / INCH_M:.2f})"
        lines += [*_doubt(row), f"kLaserNewHoodMap.put({at}, new InterpolatingDouble({row.hood_deg:.2f}));",
                  f"kLaserRPMMap.put({at}, new InterpolatingDouble({row.motor_rad_s * RPM:.1f}));"]
    return "\n".join(lines) + "\n"


def csv_2928_text(rows: Iterable[Any]) -> str:
    """A file as team 2928's robot of 2026 loads it: distance in m, hood in degrees, motor in rev/s."""
    lines = ["distance_m,hood_angle_deg,velocity_rps"]
    lines += [f"{row.distance_m:.3f},{row.hood_deg:.2f},{row.motor_rad_s / (2.0 * math.pi):.3f}" for row in rows]
    return "\n".join(lines) + "\n"


def json_3476_text(rows: Iterable[Any]) -> str:
    """A file as team 3476's shooterconfig.json of 2020: distance in inches, hood in degrees, motor in rpm."""
    configs = [{"distance": round(row.distance_m / INCH_M, 2), "hoodEjectAngle": round(row.hood_deg, 2),
                "flywheelSpeed": round(row.motor_rad_s * RPM, 1)} for row in rows]
    return json.dumps({"shooterConfigs": configs}, indent=2) + "\n"


TEAMS = {"java-6328": java_6328_text, "java-254": java_254_text, "csv-2928": csv_2928_text, "json-3476": json_3476_text}
