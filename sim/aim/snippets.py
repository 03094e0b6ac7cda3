"""Set points as lines to paste into robot code: Java and C++."""

import math
from collections.abc import Iterable
from typing import Any

RPM = 60.0 / (2.0 * math.pi)          # of one rad/s


def java_text(rows: Iterable[Any]) -> str:
    """Statements for two edu.wpi.first.math.interpolation.InterpolatingDoubleTreeMap, keyed by distance in m."""
    lines = ["// by truearc aim: distance (m) -> hood (deg above the horizontal), motor (rpm)"]
    for row in rows:
        lines += [f"hoodDeg.put({row.distance_m:.3f}, {row.hood_deg:.2f});",
                  f"motorRpm.put({row.distance_m:.3f}, {row.motor_rad_s * RPM:.1f});"]
    return "\n".join(lines) + "\n"


def cpp_text(rows: Iterable[Any]) -> str:
    """An array that needs no library."""
    lines = ["// by truearc aim: distance (m), hood (deg above the horizontal), motor (rpm)",
             "struct SetPoint { double distance_m, hood_deg, motor_rpm; };", "constexpr SetPoint kSetPoints[] = {"]
    lines += [f"    {{{row.distance_m:.3f}, {row.hood_deg:.2f}, {row.motor_rad_s * RPM:.1f}}}," for row in rows]
    return "\n".join([*lines, "};"]) + "\n"
