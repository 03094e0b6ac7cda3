"""A ball going through the wheels: MuJoCo's contact dynamics, in short steps, from first touch to last."""

import math
from typing import NamedTuple

import mujoco
import numpy as np

from truearc.sim.world.options import Options
from truearc.sim.world.parts.balls import Ball
from truearc.sim.world.parts.feeder import START_X_M, Feeder
from truearc.sim.world.scene import GRAVITY_M_S2, NIP_STEP_S, UPPER_GEAR, make_nip


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
