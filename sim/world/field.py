"""The playing field: the robot's position and motion, the camera's view, and the flight of a ball and its score.

The nip frame is aligned with the launch. The launcher frame has x horizontal out of the muzzle, y left, z up, and its
origin on the floor below the exit point. The field frame has x towards the target with x = 0 in the target plane, y
left and z up. MuJoCo's fluid forces determine the flight until the ball crosses the target plane or hits the floor. Air
may vary along the flight: for example, wind that blows only above some height, or a drag coefficient that steps with
speed. Neither applies between the wheels. `classify` gives the outcome in the target plane; BallResult records a ball.
"""

import math
from typing import NamedTuple

import mujoco
import numpy as np

from truearc.hw.emulated.nodes import View
from truearc.sim.world.goal import IN_M, STEPS, Goal
from truearc.sim.world.options import Options
from truearc.sim.world.scene import FLIGHT_STEP_S, Ball, Gap, Released, make_flight, rotate_from_launch

CENTRE_HEIGHT_M = 2.44
THREE_RADIUS_M = 0.07
TWO_HALF_HEIGHT_M = 0.35
TAPE_M = 0.0, 2.27965             # middle of the retro-reflective tape: in the same plane, and its height
TOP_SPEED_M_S = 1.5
ACCELERATION_M_S2 = 3.0
BRAKING_M_S2 = 2.0                # planned; ACCELERATION_M_S2 is what the wheels can do either way
LATERAL_M = 0.3                   # at most, and at most this share of the distance:
LATERAL_SHARE = 0.05
HEADING_DEG = 0.3                 # at most, off the line to the target's centre


class BallResult(NamedTuple):
    """Everything known of one shot; the robot never sees it, the driver only sees `outcome`.

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
    """Return the outcome as a person beside the goal would call it.

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
        """Drive with a trapezoidal speed profile, never too fast to stop at the goal."""
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


def look(pose: Pose, options: Options, mark_m: tuple[float, float] = TAPE_M) -> View:
    """Return camera axes from target axes (see View): both placed in the field, the camera on the robot's heading.

    mark_m: x and z of the middle of what marks the target."""
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
    transform[:3, 3] = camera_from_field @ (np.array([mark_m[0], 0.0, mark_m[1]]) - lens_m)
    return View(transform, options.camera_focal_scale, options.ring_light)


EXIT_HEIGHT_M = 0.75              # of the exit point: where a centred ball's centre leaves the wheels
ARC_MIDDLE_DEG = 45.0             # with release_arc the exit point is where it is without, at this elevation
LONGEST_S = 6.0                   # a ball that has met neither plane nor floor by then is out of the hall
STEP_AT_M_S, STEP_WIDTH_M_S = 9.0, 0.25           # 12 to 88 % of the step within 1 m/s
BLUNT = 1                         # the drag coefficient's place in MuJoCo's geom_fluid


def from_exit_point(released: Released, elevation_rad: float, options: Options) -> Released:
    """Convert the nip's axes to the launcher's."""
    gap = Gap.of(options)
    offset_m = rotate_from_launch(released.position_m - np.array([gap.touch_x_m, 0.0, 0.0]), elevation_rad)
    offset_m[2] += EXIT_HEIGHT_M + options.release_height_error_m
    if options.release_arc:
        arm_m = np.array([gap.touch_x_m, 0.0, -gap.lower_z_m])            # lower wheel's axle to exit point
        offset_m += (rotate_from_launch(arm_m, elevation_rad) - rotate_from_launch(arm_m, math.radians(ARC_MIDDLE_DEG)))
    return Released(offset_m, rotate_from_launch(released.velocity_m_s, elevation_rad),
                    rotate_from_launch(released.spin_rad_s, elevation_rad))


def in_field(ball: Released, pose: Pose, robot_m_s: float) -> Released:
    """Convert the launcher's axes to the field's, for a robot backing away at `robot_m_s`."""
    cos, sin = math.cos(pose.heading_rad), math.sin(pose.heading_rad)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    velocity_m_s = turn @ ball.velocity_m_s
    velocity_m_s[0] -= robot_m_s                      # the distance grows as the robot backs away
    return Released(turn @ ball.position_m + np.array([pose.x_m, pose.y_m, 0.0]), velocity_m_s, turn @ ball.spin_rad_s)


class Arrival(NamedTuple):
    """Where and when the ball's centre crossed the target plane; `y_m` and `z_m` None if it met the floor first.

    Of a target that faces up, `outcome` is what became of the ball, and `z_m` is always None."""

    after_s: float
    y_m: float | None
    z_m: float | None
    outcome: str = ""


class Flight:
    """One ball in flight; `data` is MuJoCo's: time in s since the ball left, position and velocity in the field.

    `record` has everything about the shot except the arrival. Wind and drag are constant for FLIGHT_STEP_S at a time.
    """

    def __init__(self, ball: Ball, options: Options, start: Released, record: BallResult | None = None,
                 goal: Goal | None = None) -> None:
        self._radius_m, self._options, self._record, self._goal = ball.radius_m, options, record, goal
        self._crossed_m: tuple[float, float] | None = None
        self._model = model = make_flight(ball, options, goal)
        self.data = data = mujoco.MjData(model)
        data.qpos[:3] = start.position_m
        data.qvel[:3] = start.velocity_m_s
        data.qvel[3:6] = start.spin_rad_s             # the body's axes are the field's at the start
        self._wind_m_s, self._blunt = np.array(model.opt.wind), model.geom_fluid[:, BLUNT].copy()
        self._owed_s = 0.0
        self.arrival: Arrival | None = None

    @property
    def radius_m(self) -> float:
        return self._radius_m

    def step(self, dt_s: float) -> None:
        """Fly on for dt_s in whole steps; any remainder is flown next time. Does nothing after arrival."""
        if self.arrival is not None:
            return
        model, data = self._model, self.data
        self._owed_s += dt_s
        while self._owed_s > FLIGHT_STEP_S * (1.0 - 1e-6):
            self._owed_s -= FLIGHT_STEP_S
            before = data.qpos[:3].copy(), data.qvel[:3].copy(), data.time
            self._meet_air()
            if self._goal is not None:
                self.arrival = self._meet_goal(self._goal)
                if self.arrival is not None:
                    return
                continue
            mujoco.mj_step(model, data)
            if data.qpos[0] >= 0.0 or data.qpos[2] <= self._radius_m or data.time > LONGEST_S:
                self.arrival = self._arrive(*before)
                return

    def result(self) -> BallResult | None:
        """Return the record of a ball that has arrived."""
        record, arrival = self._record, self.arrival
        if record is None or arrival is None:
            return None
        return record._replace(arrival_t_ns=record.exit_t_ns + round(arrival.after_s * 1e9), y_m=arrival.y_m,
                               z_m=arrival.z_m, outcome=arrival.outcome or classify(arrival.y_m, arrival.z_m))

    def _meet_goal(self, goal: Goal) -> Arrival | None:
        """Fly FLIGHT_STEP_S on; return what became of a ball that is far enough below the rim, or on the floor."""
        data = self.data
        for _ in range(STEPS):
            before = goal.place(data.qpos[:3])
            mujoco.mj_step(self._model, data)
            along_m, left_m, above_m = goal.place(data.qpos[:3])
            if before[2] >= 0.0 > above_m:
                share = before[2] / (before[2] - above_m)
                self._crossed_m = (before[0] + share * (along_m - before[0]), before[1] + share * (left_m - before[1]))
        fell = self._crossed_m is not None and above_m < -IN_M
        if not fell and data.qpos[2] > self._radius_m and data.time <= LONGEST_S:
            return None
        return Arrival(data.time, None if self._crossed_m is None else self._crossed_m[1], None,
                       goal.word(self._crossed_m, fell and goal.holds(along_m, left_m)))

    def _meet_air(self) -> None:
        """Set wind and drag for where the ball is, and how fast, where the options ask for either."""
        model, data, options = self._model, self.data, self._options
        if options.wind_above_m:
            model.opt.wind[:] = self._wind_m_s if data.qpos[2] >= options.wind_above_m else 0.0
        if options.drag_step:
            through_m_s = float(np.linalg.norm(data.qvel[:3] - model.opt.wind))
            share = 0.5 + 0.5 * math.tanh(0.5 * (through_m_s - STEP_AT_M_S) / STEP_WIDTH_M_S)
            model.geom_fluid[:, BLUNT] = self._blunt * (1.0 + options.drag_step * share)

    def _arrive(self, start_m: np.ndarray, start_m_s: np.ndarray, started_s: float) -> Arrival:
        data, floor_m = self.data, self._radius_m
        step_s = data.time - started_s
        end_m, start_slope, end_slope = data.qpos[:3].copy(), start_m_s * step_s, data.qvel[:3] * step_s
        plane = _share_until(start_m[0], end_m[0], start_slope[0], end_slope[0])
        floor = _share_until(start_m[2] - floor_m, end_m[2] - floor_m, start_slope[2], end_slope[2])
        if end_m[0] < 0.0 or (end_m[2] <= floor_m and floor < plane):
            share = floor if end_m[2] <= floor_m else 1.0
            return Arrival(started_s + share * step_s, None, None)
        y_m, z_m = (_hermite(start_m[i], end_m[i], start_slope[i], end_slope[i], plane) for i in (1, 2))
        return Arrival(started_s + plane * step_s, y_m, z_m)


def _hermite(start: float, end: float, start_slope: float, end_slope: float, share: float) -> float:
    s2, s3 = share * share, share**3
    return float((2 * s3 - 3 * s2 + 1) * start + (s3 - 2 * s2 + share) * start_slope
                 + (3 * s2 - 2 * s3) * end + (s3 - s2) * end_slope)


def _share_until(start: float, end: float, start_slope: float, end_slope: float) -> float:
    """Share of a step at which a coordinate passes zero: secant, then Newton on the step's cubic."""
    if start == end:
        return 0.0
    share = min(max(start / (start - end), 0.0), 1.0)
    for _ in range(3):
        slope = (end - start) or 1.0
        share -= _hermite(start, end, start_slope, end_slope, share) / slope
    return min(max(float(share), 0.0), 1.0)
