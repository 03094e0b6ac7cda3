"""Air that is not the same all along a flight: wind above a height only, a drag coefficient that steps with speed.

Between the wheels there is neither that wind nor that step.

Both are held for one step of the flight (FLIGHT_STEP_S). Where the options ask for neither, nothing is touched.
"""

import math

import mujoco
import numpy as np

from truearc.sim.world.options import Options

STEP_AT_M_S, STEP_WIDTH_M_S = 9.0, 0.25           # 12 to 88 % of the step within 1 m/s
BLUNT = 1                         # the drag coefficient's place in MuJoCo's geom_fluid


class Air:
    """The air that one ball's model flies through."""

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
