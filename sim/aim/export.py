"""Set points for robots: the aim file, its check against the simulator, and lines to paste into robot code."""

import json
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
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
from truearc.sim.aim.make_table import RPM, AimRow, on_the_move
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


def _lines(head: str, templates: Sequence[str], rows: Iterable[Any], notes: bool = True) -> str:
    """The head, and of each row the filled-in templates, below what its belief does not cover."""
    lines = [head]
    for row in rows:
        at = {"m": row.distance_m, "inch": row.distance_m / INCH_M, "hood": row.hood_deg, "zenith": 90.0 - row.hood_deg,
              "rpm": row.motor_rad_s * RPM, "rad_s": row.motor_rad_s, "rev_s": row.motor_rad_s / (2.0 * math.pi),
              "s": row.flight_s, "lead": row.lead_deg}
        lines += [f"// {row.distance_m:.3f} m: {row.note}"] if notes and row.note else []
        lines += [template.format(**at) for template in templates]
    return "\n".join(lines) + "\n"


def java_text(rows: Iterable[Any]) -> str:
    """Statements for two edu.wpi.first.math.interpolation.InterpolatingDoubleTreeMap, keyed by distance in m."""
    lead = has_lead(rows := tuple(rows))
    return _lines("// by truearc aim: distance (m) -> hood (deg above the horizontal), motor (rpm)"
                  + ", lead (deg to the left)" * lead,
                  ("hoodDeg.put({m:.3f}, {hood:.2f});", "motorRpm.put({m:.3f}, {rpm:.1f});",
                   *["leadDeg.put({m:.3f}, {lead:.2f});"] * lead), rows)


def cpp_text(rows: Iterable[Any]) -> str:
    """An array that needs no library."""
    lead = has_lead(rows := tuple(rows))
    head = ("// by truearc aim: distance (m), hood (deg above the horizontal), motor (rpm)"
            + ", lead (deg to the left)" * lead + "\nstruct SetPoint { double distance_m, hood_deg, motor_rpm"
            + ", lead_deg" * lead + "; };\nconstexpr SetPoint kSetPoints[] = {")
    lines = _lines("", ("    {{{m:.3f}, {hood:.2f}, {rpm:.1f}" + ", {lead:.2f}" * lead + "}},",), rows)
    return head + lines.replace("\n//", "\n    //") + "};\n"


def json_3476_text(rows: Iterable[Any]) -> str:
    """A file as team 3476's shooterconfig.json of 2020: distance in inches, hood in degrees, motor in rpm."""
    configs = [{"distance": round(row.distance_m / INCH_M, 2), "hoodEjectAngle": round(row.hood_deg, 2),
                "flywheelSpeed": round(row.motor_rad_s * RPM, 1)} for row in rows]
    return json.dumps({"shooterConfigs": configs}, indent=2) + "\n"


# Shapes of teams' public code. 6328's ShotCalculator of 2026: hood from the vertical, in InterpolatingTreeMap and
# InterpolatingDoubleTreeMap of WPILib; 254's Constants of 2020; files as 2928's robot of 2026 and 3476's of 2020 load
# them.
TEAMS: dict[str, Callable[[Iterable[Any]], str]] = {
    "java-6328": partial(_lines, "// by truearc aim: distance (m) -> hood (deg from the vertical), motor (rad/s), time "
                         "of flight (s)", ("shotHoodAngleMap.put({m:.3f}, Rotation2d.fromDegrees({zenith:.2f}));",
                                        "shotFlywheelSpeedMap.put({m:.3f}, {rad_s:.2f});",
                                        "timeOfFlightMap.put({m:.3f}, {s:.3f});")),
    "java-254": partial(_lines, "// by truearc aim: distance (in) -> hood (deg above the horizontal), motor (rpm)", (
        "kLaserNewHoodMap.put(new InterpolatingDouble({inch:.2f}), new InterpolatingDouble({hood:.2f}));",
        "kLaserRPMMap.put(new InterpolatingDouble({inch:.2f}), new InterpolatingDouble({rpm:.1f}));")),
    "csv-2928": partial(_lines, "distance_m,hood_angle_deg,velocity_rps", ("{m:.3f},{hood:.2f},{rev_s:.3f}",),
                        notes=False),
    "json-3476": json_3476_text}
