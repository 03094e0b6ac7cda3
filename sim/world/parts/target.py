"""The goal: which part of it a ball went through, and the record of each shot."""

import math
from typing import NamedTuple

CENTRE_HEIGHT_M = 2.44
THREE_RADIUS_M = 0.07
TWO_HALF_HEIGHT_M = 0.35
TAPE_HEIGHT_M = 2.27965           # middle of the retro-reflective tape, in the same plane


class BallResult(NamedTuple):
    """All there is to know of one shot; the robot never sees it, the driver only sees `outcome`.

    Speed, elevation and spin (backspin positive) are those on leaving the wheels, relative to the robot; `y_m` is left
    of the target's centre and `z_m` above the floor where the ball's centre crossed the plane, None if it never did.
    """

    shot: int
    ball_id: str
    distance_m: float
    hood_deg: float
    wheel_before_rad_s: float
    wheel_after_rad_s: float
    exit_speed_m_s: float
    exit_deg: float
    exit_spin_rev_s: float
    fed_t_ns: int                 # the ball reached the wheels
    exit_t_ns: int
    arrival_t_ns: int = 0         # this and what follows: once it has arrived
    y_m: float | None = None
    z_m: float | None = None
    outcome: str = ""             # the button that says it: "three", "two-low", "miss-high", ...


def classify(y_m: float | None, z_m: float | None) -> str:
    """What someone beside the goal would call it.

    "three" within a circle about the centre; "two" inside the regular hexagon that stands on a flat side (its half
    height is the apothem); else a miss by the sign of the height error; a ball that never crossed is "miss-low". A
    "two" that passes above or below the circle is "two-high" or "two-low".
    """
    if y_m is None or z_m is None:
        return "miss-low"
    up_m = z_m - CENTRE_HEIGHT_M
    if math.hypot(y_m, up_m) <= THREE_RADIUS_M:
        return "three"
    slanted_m = math.cos(math.radians(30.0)) * abs(y_m) + math.sin(math.radians(30.0)) * abs(up_m)
    if abs(up_m) <= TWO_HALF_HEIGHT_M and slanted_m <= TWO_HALF_HEIGHT_M:
        return "two" if abs(up_m) <= THREE_RADIUS_M else "two-high" if up_m > 0.0 else "two-low"
    return "miss-high" if up_m > 0.0 else "miss-low"
