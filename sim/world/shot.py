"""One ball from the wheels to the goal: the axes it passes through, and what is written down of it.

The nip's axes lie along the launch; the launcher's have x horizontal out of the muzzle, y left, z up and their origin
on the floor below the exit point; the field's have x towards the target with 0 in its plane, y left, z up.
"""

import math
from typing import NamedTuple

import numpy as np

from truearc.sim.world.flight import Arrival, Flight
from truearc.sim.world.options import Options
from truearc.sim.world.parts.balls import Ball
from truearc.sim.world.parts.chassis import Pose
from truearc.sim.world.parts.target import BallResult, classify
from truearc.sim.world.parts.wheel_contact import Released, rotate_from_launch
from truearc.sim.world.scene import LOWER_Z_M, TOUCH_X_M

EXIT_HEIGHT_M = 0.75              # of the exit point: where a centred ball's centre leaves the wheels
ARC_MIDDLE_DEG = 45.0             # with release_arc the exit point is where it is without, at this elevation


class Launch(NamedTuple):
    """What is known of a ball before it arrives."""

    shot: int
    ball: Ball
    flight: Flight
    distance_m: float
    hood_deg: float
    wheel_before_rad_s: float
    wheel_after_rad_s: float
    velocity_m_s: np.ndarray      # launcher axes
    spin_rad_s: np.ndarray
    fed_t_ns: int
    exit_t_ns: int


def from_exit_point(released: Released, elevation_rad: float, options: Options) -> Released:
    """From the nip's axes to the launcher's."""
    offset_m = rotate_from_launch(released.position_m - np.array([TOUCH_X_M, 0.0, 0.0]), elevation_rad)
    offset_m[2] += EXIT_HEIGHT_M + options.release_height_error_m
    if options.release_arc:
        arm_m = np.array([TOUCH_X_M, 0.0, -LOWER_Z_M])            # lower wheel's axle to exit point
        offset_m += (rotate_from_launch(arm_m, elevation_rad)
                     - rotate_from_launch(arm_m, math.radians(ARC_MIDDLE_DEG)))
    return Released(offset_m, rotate_from_launch(released.velocity_m_s, elevation_rad),
                    rotate_from_launch(released.spin_rad_s, elevation_rad))


def in_field(ball: Released, pose: Pose, robot_m_s: float) -> Released:
    """From the launcher's axes to the field's, for a robot backing away at `robot_m_s`."""
    cos, sin = math.cos(pose.heading_rad), math.sin(pose.heading_rad)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    velocity_m_s = turn @ ball.velocity_m_s
    velocity_m_s[0] -= robot_m_s                      # the distance grows as the robot backs away
    return Released(turn @ ball.position_m + np.array([pose.x_m, pose.y_m, 0.0]), velocity_m_s, turn @ ball.spin_rad_s)


def result_of(launch: Launch, arrival: Arrival) -> BallResult:
    """The record of a ball that has arrived."""
    velocity = launch.velocity_m_s
    return BallResult(
        shot=launch.shot,
        ball_id=launch.ball.ball_id,
        distance_m=launch.distance_m,
        hood_deg=launch.hood_deg,
        wheel_before_rad_s=launch.wheel_before_rad_s,
        wheel_after_rad_s=launch.wheel_after_rad_s,
        exit_speed_m_s=float(np.linalg.norm(velocity)),
        exit_deg=math.degrees(math.atan2(velocity[2], math.hypot(velocity[0], velocity[1]))),
        exit_spin_rev_s=float(-launch.spin_rad_s[1]) / (2.0 * math.pi),
        fed_t_ns=launch.fed_t_ns,
        exit_t_ns=launch.exit_t_ns,
        arrival_t_ns=launch.exit_t_ns + round(arrival.after_s * 1e9),
        y_m=arrival.y_m,
        z_m=arrival.z_m,
        outcome=classify(arrival.y_m, arrival.z_m),
    )
