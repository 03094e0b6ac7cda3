"""Where the robot stands, as far as a recording says so.

Frame "target": origin on the floor below the middle of the target, x from the target toward the robot, z up, y so that
the frame is right-handed (to the right as the robot sees it). Known are the horizontal distance from the ball's exit to
the target plane and, where the camera gives one, the bearing of the target. Assumed: the robot stands straight in front
of the target (y = 0), and the camera looks where the launcher throws. Without a bearing it faces the target.
"""

import math
from typing import NamedTuple

from truearc.robot.types import Tick

ASSUMED = (
    "frame target: origin on the floor below the middle of the target, x toward the robot, z up. Known: distance (ball "
    "exit to target plane) and bearing, if the camera gave one. Assumed: the robot is straight in front of the target "
    "(y = 0) and the camera looks where the launcher throws")


class FieldPose(NamedTuple):
    """The point on the floor below the ball's exit, in m, and the direction of throw, anticlockwise from x, in rad."""

    x_m: float
    y_m: float
    yaw_rad: float


def pose_of(tick: Tick) -> FieldPose | None:
    """The pose at a tick; None while no distance is known."""
    if tick.estimate.distance_m is None:
        return None
    sighting = tick.memory.last_sighting
    bearing_deg = 0.0 if sighting is None or sighting.bearing_deg is None else sighting.bearing_deg
    return FieldPose(tick.estimate.distance_m, 0.0, math.remainder(math.pi + math.radians(bearing_deg), 2.0 * math.pi))


def in_target_frame(distance_m: float, x_m: float, y_m: float, z_m: float) -> tuple[float, float, float]:
    """A point of the launcher's frame (x toward the target, y left, z up from the floor) of a robot at a distance."""
    return distance_m - x_m, -y_m, z_m
