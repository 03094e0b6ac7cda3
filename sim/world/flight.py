"""A ball in the air, by MuJoCo's own fluid forces, until it crosses the target plane or meets the floor.

Field axes: x towards the target with 0 in its plane, y left, z up from the floor.
"""

from typing import NamedTuple

import mujoco
import numpy as np

from truearc.sim.world.options import Options
from truearc.sim.world.parts.air import Air
from truearc.sim.world.parts.balls import Ball
from truearc.sim.world.parts.wheel_contact import Released
from truearc.sim.world.scene import FLIGHT_STEP_S, make_flight

LONGEST_S = 6.0                   # a ball that has met neither plane nor floor by then is out of the hall


class Arrival(NamedTuple):
    """Where and when the ball's centre crossed the target plane; `y_m` and `z_m` None if it met the floor first."""

    after_s: float
    y_m: float | None
    z_m: float | None


class Flight:
    """One ball in flight."""

    def __init__(self, ball: Ball, options: Options, start: Released) -> None:
        self._radius_m = ball.radius_m
        self._model = make_flight(ball, options)
        self._data = data = mujoco.MjData(self._model)
        data.qpos[:3] = start.position_m
        data.qvel[:3] = start.velocity_m_s
        data.qvel[3:6] = start.spin_rad_s             # the body's axes are the field's at the start
        self._owed_s = 0.0
        self._air = Air(options, self._model)
        self.arrival: Arrival | None = None

    @property
    def position_m(self) -> np.ndarray:
        return np.array(self._data.qpos[:3])

    @property
    def time_s(self) -> float:
        """Since the ball left; position and velocity are of this moment."""
        return float(self._data.time)

    @property
    def velocity_m_s(self) -> np.ndarray:
        return np.array(self._data.qvel[:3])

    def step(self, dt_s: float) -> None:
        """Fly on for dt_s in whole steps; what is short of one is flown next time. Nothing once arrived."""
        if self.arrival is not None:
            return
        model, data = self._model, self._data
        self._owed_s += dt_s
        while self._owed_s > FLIGHT_STEP_S * (1.0 - 1e-6):
            self._owed_s -= FLIGHT_STEP_S
            before, started_s = (data.qpos[:3].copy(), data.qvel[:3].copy()), data.time
            self._air.meet(data)
            mujoco.mj_step(model, data)
            if data.qpos[0] >= 0.0 or data.qpos[2] <= self._radius_m or data.time > LONGEST_S:
                self.arrival = self._arrive(before, started_s)
                return

    def _arrive(self, before: tuple[np.ndarray, np.ndarray], started_s: float) -> Arrival:
        data = self._data
        step_s = data.time - started_s
        after = (data.qpos[:3].copy(), data.qvel[:3].copy())
        plane = _share_until(before[0][0], after[0][0], before[1][0] * step_s, after[1][0] * step_s)
        floor_m = self._radius_m
        floor = _share_until(before[0][2] - floor_m, after[0][2] - floor_m, before[1][2] * step_s,
                             after[1][2] * step_s)
        if after[0][0] < 0.0 or (after[0][2] <= floor_m and floor < plane):
            share = floor if after[0][2] <= floor_m else 1.0
            return Arrival(started_s + share * step_s, None, None)
        place = [_hermite(before[0][i], after[0][i], before[1][i] * step_s, after[1][i] * step_s, plane)
                 for i in (1, 2)]
        return Arrival(started_s + plane * step_s, place[0], place[1])


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
