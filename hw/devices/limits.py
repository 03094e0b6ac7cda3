"""Bounds that an axis never exceeds while all is well, and its own controller's limits, which stand behind the robot's."""

import math
from typing import NamedTuple

SPEED_SPARE = 1.15                    # times the top speed: an ODrive's torque fades as its speed nears the limit
CURRENT_SPARE = 1.1                   # times the current of the top torque, so that no rounding cuts it


class Bounds(NamedTuple):
    """Of one axis, at the motor's shaft, from the rest of the configuration; None: nothing is known of it.

    top_rad_s, top_nm: speed and torque that it never passes while all is well.
    brakes: whether it is to brake when it is let go, rather than coast.
    """

    top_rad_s: float | None = None
    top_nm: float | None = None
    brakes: bool | None = None


def speed_limit_rad_s(bounds: Bounds) -> float | None:
    """The controller's own limit; None where the axis has none."""
    return None if bounds.top_rad_s is None else SPEED_SPARE * bounds.top_rad_s


def current_limit_a(bounds: Bounds, torque_nm_a: float) -> float | None:
    """The controller's own limit, of a motor that gives so much torque per A; None where that is 0, for unknown."""
    if bounds.top_nm is None or not torque_nm_a:
        return None
    asked_a = CURRENT_SPARE * bounds.top_nm / torque_nm_a
    return float(math.ceil(asked_a)) if math.isfinite(asked_a) else asked_a
