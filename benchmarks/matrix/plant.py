"""A small world for the emulated devices: the launcher of launcher.toml without its balls' flight, in closed steps.

It is ready to fire a second and a half after it has been armed, and costs next to nothing.
"""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from truearc.hw.devices.spark.family import SparkConfig
from truearc.hw.emulated.nodes import MotorTruth, View
from truearc.robot.config.schema import Config
from truearc.robot.motors import elevation_from_screw_deg

TORQUE_NM_A = 0.02
BELT_KG_M2 = 0.0067                   # both flywheels, both motors
SCREW_NM_S = 0.0015                   # what the hood's screw needs to turn ...
STIFF_NM_S = 0.006                    # ... that is without inertia, so on a duty more than the motor's own 0.0044
START_DEG = 1.0                       # above its limit switch the hood is found
BALL_NM = 0.05                        # with this on the feeder a ball goes in
STEP_S = 0.005


class Ball(NamedTuple):
    """True values when a ball went in."""

    t_ns: int
    motor_rad_s: float
    hood_deg: float


class SmallPlant:
    """truearc.hw.emulated.nodes.Plant: two motors on one belt, a hood on a screw that locks itself, a feeder."""

    motors = ("flywheel_a", "flywheel_b", "hood", "feeder")

    def __init__(self, config: Config) -> None:
        self.balls: list[Ball] = []
        self._config = config
        self._screw_nm_s = STIFF_NM_S if isinstance(config.axes.hood, SparkConfig) else SCREW_NM_S
        self._t_ns = 0
        self._belt_rad = self._belt_rad_s = 0.0
        self._screw_rad = START_DEG / 0.2
        self._feeder_rad = self._screw_rad_s = self._feeder_rad_s = 0.0
        self._torque_nm = dict.fromkeys(self.motors, 0.0)

    def advance(self, t_ns: int, torque_nm: Mapping[str, float]) -> None:
        before_nm = self._torque_nm["feeder"]
        self._torque_nm = {name: torque_nm.get(name, 0.0) for name in self.motors}
        left_s = (t_ns - self._t_ns) * 1e-9
        while left_s > 0.0:
            self._step(min(left_s, STEP_S))
            left_s -= STEP_S
        self._t_ns = t_ns
        if self._torque_nm["feeder"] > BALL_NM >= before_nm:
            self.balls.append(Ball(t_ns, self._belt_rad_s, self.hood_deg()))

    def motor(self, name: str) -> MotorTruth:
        torque_nm = self._torque_nm[name]
        position_rad, velocity_rad_s = {"hood": (self._screw_rad, self._screw_rad_s),
                                        "feeder": (self._feeder_rad, self._feeder_rad_s)}.get(
            name, (self._belt_rad, self._belt_rad_s))
        return MotorTruth(position_rad, velocity_rad_s, torque_nm, torque_nm / TORQUE_NM_A)

    def bus_v(self) -> float:
        return 12.25

    def hood_deg(self) -> float:
        hood = self._config.hood
        return elevation_from_screw_deg(self._screw_rad, hood) or hood.high_deg

    def hood_encoder_rad(self) -> float:
        return math.radians(self.hood_deg())

    def hood_at_limit(self) -> bool:
        return self._screw_rad <= 0.0

    def view(self) -> View:
        return View(np.eye(4), 1.0, 1.0)

    def _step(self, step_s: float) -> None:
        wheel, torque_nm = self._config.flywheel, self._torque_nm
        drag_nm = 2.0 * (wheel.ks_nm + wheel.kv_nm_s * self._belt_rad_s) if self._belt_rad_s > 0.0 else 0.0
        push_nm = torque_nm["flywheel_a"] + torque_nm["flywheel_b"] - drag_nm
        self._belt_rad_s = max(self._belt_rad_s + push_nm / BELT_KG_M2 * step_s, 0.0)
        self._belt_rad += self._belt_rad_s * step_s
        hood_nm = torque_nm["hood"]
        free_nm = math.copysign(max(abs(hood_nm) - self._config.hood.friction_nm, 0.0), hood_nm)
        screw_rad = max(self._screw_rad + free_nm / self._screw_nm_s * step_s, 0.0)
        self._screw_rad, self._screw_rad_s = screw_rad, (screw_rad - self._screw_rad) / step_s
        self._feeder_rad_s = torque_nm["feeder"] * 100.0
        self._feeder_rad += self._feeder_rad_s * step_s


class AdvisedPlant(SmallPlant):
    """The launcher of another controller, which does as it is advised; what hangs on the bus drives nothing."""

    def __init__(self, config: Config, advice: Callable[[], tuple[float, float, float]]) -> None:
        """`advice`: torques for each flywheel motor, the hood and the feeder."""
        super().__init__(config)
        self._advice = advice

    def advance(self, t_ns: int, torque_nm: Mapping[str, float]) -> None:
        wheel_nm, hood_nm, feeder_nm = self._advice()
        super().advance(t_ns, dict(zip(self.motors, (wheel_nm, wheel_nm, hood_nm, feeder_nm), strict=True)))
