"""Set points as lines to paste into robot code: Java and C++, and as four teams' public code has its tables."""

import json
import math
from collections.abc import Iterable
from typing import Any

RPM = 60.0 / (2.0 * math.pi)          # of one rad/s
LEAST_LEAD_DEG = 0.05                 # what is less is left out
INCH_M = 0.0254


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
