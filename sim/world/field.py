"""The field: where the robot stands and drives, what its camera sees from there, and the goal that balls go through."""

import math
from typing import NamedTuple

import numpy as np

from truearc.hw.emulated.nodes import View
from truearc.sim.world.options import Options

CENTRE_HEIGHT_M = 2.44
THREE_RADIUS_M = 0.07
TWO_HALF_HEIGHT_M = 0.35
TAPE_HEIGHT_M = 2.27965           # middle of the retro-reflective tape, in the same plane
TOP_SPEED_M_S = 1.5
ACCELERATION_M_S2 = 3.0
BRAKING_M_S2 = 2.0                # planned; ACCELERATION_M_S2 is what the wheels can do either way
LATERAL_M = 0.3                   # at most, and at most this share of the distance:
LATERAL_SHARE = 0.05
HEADING_DEG = 0.3                 # at most, off the line to the target's centre


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


class Pose(NamedTuple):
    """Exit point in field axes (x towards the target, 0 in its plane; y left) and heading, left of x positive."""

    x_m: float
    y_m: float
    heading_rad: float


class Chassis:
    """A robot that drives along the field's axis with limited speed and acceleration, and parks a little askew."""

    def __init__(self, seed: int, distance_m: float, pose_scale: float) -> None:
        self._rng = np.random.default_rng([seed, 4])
        self._scale = pose_scale
        self.distance_m = distance_m
        self.speed_m_s = 0.0                          # growing distance is positive
        self._start_m = self._goal_m = distance_m
        self._old = self._new = self._draw(distance_m)
        self._pose: Pose | None = None

    @property
    def moving(self) -> bool:
        return self.distance_m != self._goal_m or self.speed_m_s != 0.0

    def drive_to(self, distance_m: float) -> None:
        self._old = self._errors()
        self._start_m, self._goal_m = self.distance_m, distance_m
        self._new = self._draw(distance_m)
        self._pose = None

    def step(self, dt_s: float) -> None:
        """Trapezoid in speed: never faster than what still stops at the goal."""
        if not self.moving:
            return
        left_m = self._goal_m - self.distance_m
        most_m_s = min(TOP_SPEED_M_S, math.sqrt(2.0 * BRAKING_M_S2 * abs(left_m)))
        change = ACCELERATION_M_S2 * dt_s
        wanted_m_s = math.copysign(most_m_s, left_m)
        self.speed_m_s += min(max(wanted_m_s - self.speed_m_s, -change), change)
        ahead_m = self.speed_m_s * dt_s
        if abs(left_m) <= max(abs(ahead_m), 1e-3) and abs(self.speed_m_s) < 0.2:
            self.distance_m, self.speed_m_s = self._goal_m, 0.0
        else:
            self.distance_m += ahead_m
        self._pose = None

    def pose(self) -> Pose:
        if self._pose is None:
            lateral_m, error_rad = self._errors()
            self._pose = Pose(-self.distance_m, lateral_m, math.atan2(-lateral_m, self.distance_m) + error_rad)
        return self._pose

    def _errors(self) -> tuple[float, float]:
        span_m = self._goal_m - self._start_m
        share = 1.0 if span_m == 0.0 else min(max((self.distance_m - self._start_m) / span_m, 0.0), 1.0)
        return (self._old[0] + share * (self._new[0] - self._old[0]),
                self._old[1] + share * (self._new[1] - self._old[1]))

    def _draw(self, distance_m: float) -> tuple[float, float]:
        side, turn = self._rng.uniform(-1.0, 1.0, 2) * self._scale
        return (float(side * min(LATERAL_M, LATERAL_SHARE * distance_m)), float(math.radians(HEADING_DEG) * turn))


def look(pose: Pose, options: Options) -> View:
    """Camera axes from target axes (see View): both placed in the field, the camera on the robot's heading."""
    cos_h, sin_h = math.cos(pose.heading_rad), math.sin(pose.heading_rad)
    pitch_rad = math.radians(options.camera_pitch_deg + options.camera_pitch_error_deg)
    forward = np.array([cos_h * math.cos(pitch_rad), sin_h * math.cos(pitch_rad), math.sin(pitch_rad)])
    right = np.array([sin_h, -cos_h, 0.0])
    camera_from_field = np.array([right, np.cross(forward, right), forward])
    lens_m = np.array([pose.x_m - options.camera_behind_exit_m * cos_h,
                       pose.y_m - options.camera_behind_exit_m * sin_h, options.camera_height_m])
    field_from_target = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    transform = np.eye(4)
    transform[:3, :3] = camera_from_field @ field_from_target
    transform[:3, 3] = camera_from_field @ (np.array([0.0, 0.0, TAPE_HEIGHT_M]) - lens_m)
    return View(transform, options.camera_focal_scale, options.ring_light)
