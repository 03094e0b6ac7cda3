"""One ball from the wheels to the goal: the axes it passes through, its flight, and the record of it.

The nip's axes lie along the launch; the launcher's have x horizontal out of the muzzle, y left, z up and their origin
on the floor below the exit point; the field's have x towards the target with 0 in its plane, y left, z up. The flight
is by MuJoCo's own fluid forces, until the ball crosses the target plane or meets the floor. Air may differ along it:
wind above a height only, a drag coefficient that steps with speed. Between the wheels there is neither.
"""

import math
from typing import NamedTuple

import mujoco
import numpy as np

from truearc.sim.world.field import BallResult, Pose, classify
from truearc.sim.world.nip import Released, rotate_from_launch
from truearc.sim.world.options import Options
from truearc.sim.world.scene import FLIGHT_STEP_S, LOWER_Z_M, TOUCH_X_M, Ball, make_flight

EXIT_HEIGHT_M = 0.75              # of the exit point: where a centred ball's centre leaves the wheels
ARC_MIDDLE_DEG = 45.0             # with release_arc the exit point is where it is without, at this elevation
LONGEST_S = 6.0                   # a ball that has met neither plane nor floor by then is out of the hall
STEP_AT_M_S, STEP_WIDTH_M_S = 9.0, 0.25           # 12 to 88 % of the step within 1 m/s
BLUNT = 1                         # the drag coefficient's place in MuJoCo's geom_fluid


def from_exit_point(released: Released, elevation_rad: float, options: Options) -> Released:
    """From the nip's axes to the launcher's."""
    offset_m = rotate_from_launch(released.position_m - np.array([TOUCH_X_M, 0.0, 0.0]), elevation_rad)
    offset_m[2] += EXIT_HEIGHT_M + options.release_height_error_m
    if options.release_arc:
        arm_m = np.array([TOUCH_X_M, 0.0, -LOWER_Z_M])            # lower wheel's axle to exit point
        offset_m += (rotate_from_launch(arm_m, elevation_rad) - rotate_from_launch(arm_m, math.radians(ARC_MIDDLE_DEG)))
    return Released(offset_m, rotate_from_launch(released.velocity_m_s, elevation_rad),
                    rotate_from_launch(released.spin_rad_s, elevation_rad))


def in_field(ball: Released, pose: Pose, robot_m_s: float) -> Released:
    """From the launcher's axes to the field's, for a robot backing away at `robot_m_s`."""
    cos, sin = math.cos(pose.heading_rad), math.sin(pose.heading_rad)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    velocity_m_s = turn @ ball.velocity_m_s
    velocity_m_s[0] -= robot_m_s                      # the distance grows as the robot backs away
    return Released(turn @ ball.position_m + np.array([pose.x_m, pose.y_m, 0.0]), velocity_m_s, turn @ ball.spin_rad_s)


class Arrival(NamedTuple):
    """Where and when the ball's centre crossed the target plane; `y_m` and `z_m` None if it met the floor first."""

    after_s: float
    y_m: float | None
    z_m: float | None


class Air:
    """The air that one ball's model flies through; wind and drag are held for FLIGHT_STEP_S at a time.

    Where the options ask for neither a wind above a height nor a drag step, the model stays as it is.
    """

    def __init__(self, options: Options, model: mujoco.MjModel) -> None:
        self._model = model
        self._above_m = options.wind_above_m
        self._step = options.drag_step
        self._wind_m_s = np.array(model.opt.wind)
        self._blunt = model.geom_fluid[:, BLUNT].copy()

    def meet(self, data: mujoco.MjData) -> None:
        """Set wind and drag for where the ball is, and how fast."""
        if self._above_m:
            self._model.opt.wind[:] = self._wind_m_s if data.qpos[2] >= self._above_m else 0.0
        if self._step:
            through_m_s = float(np.linalg.norm(data.qvel[:3] - self._model.opt.wind))
            share = 0.5 + 0.5 * math.tanh(0.5 * (through_m_s - STEP_AT_M_S) / STEP_WIDTH_M_S)
            self._model.geom_fluid[:, BLUNT] = self._blunt * (1.0 + self._step * share)


class Flight:
    """One ball in flight; `data` is MuJoCo's: time in s since the ball left, position and velocity in the field."""

    def __init__(self, ball: Ball, options: Options, start: Released) -> None:
        self._radius_m = ball.radius_m
        self._model = make_flight(ball, options)
        self.data = data = mujoco.MjData(self._model)
        data.qpos[:3] = start.position_m
        data.qvel[:3] = start.velocity_m_s
        data.qvel[3:6] = start.spin_rad_s             # the body's axes are the field's at the start
        self._owed_s = 0.0
        self._air = Air(options, self._model)
        self.arrival: Arrival | None = None

    def step(self, dt_s: float) -> None:
        """Fly on for dt_s in whole steps; what is short of one is flown next time. Nothing once arrived."""
        if self.arrival is not None:
            return
        model, data = self._model, self.data
        self._owed_s += dt_s
        while self._owed_s > FLIGHT_STEP_S * (1.0 - 1e-6):
            self._owed_s -= FLIGHT_STEP_S
            before = data.qpos[:3].copy(), data.qvel[:3].copy(), data.time
            self._air.meet(data)
            mujoco.mj_step(model, data)
            if data.qpos[0] >= 0.0 or data.qpos[2] <= self._radius_m or data.time > LONGEST_S:
                self.arrival = self._arrive(*before)
                return

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


class Launch(NamedTuple):
    """A ball in the air, and its record with everything but the arrival."""

    flight: Flight
    record: BallResult

    def arrive(self, arrival: Arrival) -> BallResult:
        """Return the record of the ball that has arrived."""
        return self.record._replace(arrival_t_ns=self.record.exit_t_ns + round(arrival.after_s * 1e9),
                                    y_m=arrival.y_m, z_m=arrival.z_m, outcome=classify(arrival.y_m, arrival.z_m))


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
