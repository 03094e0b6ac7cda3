"""Set points as lines to paste into robot code: Java and C++."""

import math
from collections.abc import Iterable
from typing import Any

RPM = 60.0 / (2.0 * math.pi)          # of one rad/s
LEAST_LEAD_DEG = 0.05                 # what is less is left out


def has_lead(rows: Iterable[Any]) -> bool:
    """Whether a set point is aimed beside the target."""
    return any(abs(row.lead_deg) >= LEAST_LEAD_DEG for row in rows)


def java_text(rows: Iterable[Any]) -> str:
    """Statements for two edu.wpi.first.math.interpolation.InterpolatingDoubleTreeMap, keyed by distance in m."""
    rows = tuple(rows)
    lead = has_lead(rows)
    lines = ["// by truearc aim: distance (m) -> hood (deg above the horizontal), motor (rpm)"
             + ", lead (deg to the left)" * lead]
    for row in rows:
        lines += [f"hoodDeg.put({row.distance_m:.3f}, {row.hood_deg:.2f});",
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
    lines += [f"    {{{row.distance_m:.3f}, {row.hood_deg:.2f}, {row.motor_rad_s * RPM:.1f}"
              + f", {row.lead_deg:.2f}" * lead + "}," for row in rows]
    return "\n".join([*lines, "};"]) + "\n"
