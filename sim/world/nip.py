"""A ball going through the wheels: a roller feeds it along a chute, and MuJoCo computes its contacts."""

import math
from typing import NamedTuple

import mujoco
import numpy as np

from truearc.sim.world.drive import UPPER_GEAR, step_shaft
from truearc.sim.world.options import Options
from truearc.sim.world.scene import GRAVITY_M_S2, NIP_STEP_S, TOUCH_X_M, Ball, make_nip

ROLLER_M = 0.004                  # ball travel per radian of the motor
INERTIA_KG_M2 = 3e-5              # rotor, gears, roller
VISCOUS_NM_S = 6e-4
COULOMB_NM = 0.02
CHUTE_M = 0.05                    # from where a ball waits to where it touches the wheels
MARGIN_M = 0.002                  # the nip is simulated from this far before contact
GRIP_N_S_M = 40.0                 # pull of the roller on a ball that the wheels hold back
PULL_N = 8.0
REACH_M = 0.03                    # the roller lets go this far before the line of wheel centres
RELOAD_S = 0.5                    # the hopper's next ball is there this long after the last one left

START_X_M = -TOUCH_X_M - MARGIN_M
WAIT_X_M = START_X_M - CHUTE_M


class Feeder:
    """Motor and roller; `ball_x_m` is the waiting ball's place in the nip's axes, None while there is none."""

    def __init__(self) -> None:
        self.speed_rad_s = 0.0
        self.position_rad = 0.0
        self.ball_x_m: float | None = WAIT_X_M
        self._reload_s = 0.0

    @property
    def surface_m_s(self) -> float:
        return self.speed_rad_s * ROLLER_M

    def step(self, torque_nm: float, dt_s: float) -> float | None:
        """Turn for dt_s; when the ball reaches the wheels, the part of dt_s that was left then, else None."""
        self.speed_rad_s, turned_rad = step_shaft(self.speed_rad_s, torque_nm, dt_s, INERTIA_KG_M2, VISCOUS_NM_S,
                                                  COULOMB_NM)
        self.position_rad += turned_rad
        if self._reload_s > 0.0:
            self._reload_s -= dt_s
            self.ball_x_m = WAIT_X_M if self._reload_s <= 0.0 else self.ball_x_m
        if self.ball_x_m is None:
            return None
        ahead_m = turned_rad * ROLLER_M
        place_m = max(self.ball_x_m + ahead_m, WAIT_X_M)
        if place_m < START_X_M:
            self.ball_x_m = place_m
            return None
        left_s = dt_s * (place_m - START_X_M) / ahead_m if ahead_m > 0.0 else 0.0
        self.ball_x_m = None
        return min(left_s, dt_s)

    def pull_n(self, x_m: float, velocity_m_s: float) -> float:
        """Force along the launch direction on a ball in the nip."""
        if x_m > -REACH_M:
            return 0.0
        return min(max(GRIP_N_S_M * (self.surface_m_s - velocity_m_s), -PULL_N), PULL_N)

    def expect_ball(self) -> None:
        """The ball has left: the hopper sends the next one."""
        self._reload_s = RELOAD_S

    def take_back(self, x_m: float) -> None:
        """The wheels threw the ball back into the chute."""
        self.ball_x_m = max(min(x_m, START_X_M - 1e-4), WAIT_X_M)


class Released(NamedTuple):
    """A ball's state as it leaves, in the axes of whoever says so."""

    position_m: np.ndarray
    velocity_m_s: np.ndarray
    spin_rad_s: np.ndarray


def rotate_from_launch(vector: np.ndarray, elevation_rad: float) -> np.ndarray:
    """From the nip's axes (x along the launch, z across the gap) to x horizontal, z up."""
    cos, sin = math.cos(elevation_rad), math.sin(elevation_rad)
    return np.array([cos * vector[0] - sin * vector[2], vector[1], sin * vector[0] + cos * vector[2]])


class Nip:
    """Wheels and ball while they touch; `wheel_rad_s` is the lower wheel's, which is the motors'."""

    def __init__(self, ball: Ball, options: Options, elevation_rad: float, wheel_rad_s: float, feed_m_s: float,
                 step_s: float = NIP_STEP_S) -> None:
        """`step_s`: of MuJoCo, at most about so long."""
        gravity = rotate_from_launch(np.array([0.0, 0.0, -GRAVITY_M_S2]), -elevation_rad)
        blowing = np.array([options.wind_x_m_s, options.wind_y_m_s, options.wind_z_m_s])
        wind = rotate_from_launch(np.zeros(3) if options.wind_above_m else blowing, -elevation_rad)
        self.ball = ball
        self._step_s = step_s
        self.elevation_rad = elevation_rad
        self._model = make_nip(ball, options, gravity, wind)
        self._data = data = mujoco.MjData(self._model)
        data.qpos[2:5] = (START_X_M, 0.0, ball.seat_m)
        data.qvel[:5] = (wheel_rad_s, UPPER_GEAR * wheel_rad_s, feed_m_s, ball.side_m_s, 0.0)
        self._touched = False
        self.released: Released | None = None
        self.thrown_back = False

    @property
    def wheel_rad_s(self) -> float:
        return float(self._data.qvel[0])

    @property
    def x_m(self) -> float:
        return float(self._data.qpos[2])

    def step(self, torque_nm: float, feeder: Feeder, dt_s: float) -> float:
        """Advance by dt_s or until the ball is gone; the part of dt_s that is left (0 while it is still here)."""
        model, data = self._model, self._data
        steps = max(1, round(dt_s / self._step_s))
        model.opt.timestep = dt_s / steps
        data.qfrc_applied[0] = torque_nm
        for done in range(1, steps + 1):
            data.qfrc_applied[2] = feeder.pull_n(data.qpos[2], data.qvel[2])
            mujoco.mj_step(model, data)
            if self._gone():
                return dt_s * (steps - done) / steps
        return 0.0

    def _gone(self) -> bool:
        data = self._data
        if data.ncon:
            self._touched = True
            return False
        if data.qpos[2] > 0.0 and self._touched:
            self.released = self._release()
            return True
        self.thrown_back = bool(data.qpos[2] < START_X_M - 0.002)
        return self.thrown_back

    def _release(self) -> Released:
        data = self._data
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, data.qpos[5:9])
        return Released(data.qpos[2:5].copy(), data.qvel[2:5].copy(), turn.reshape(3, 3) @ data.qvel[5:8])
