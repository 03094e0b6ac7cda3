"""All that an emulated device may ask of the world it is attached to.

`truearc.sim.world` implements it; the devices here only quantise, delay and put on the wire.
"""

from collections.abc import Mapping
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt


class MotorTruth(NamedTuple):
    """One motor as its own encoder and driver see it (an encoder with a wrong scale has it applied here)."""

    position_rad: float
    velocity_rad_s: float
    torque_nm: float                  # really produced, after the torque-speed curve and the supply
    current_a: float


class View(NamedTuple):
    """Pose and light of the target before the camera. Camera axes: x right, y down, z along the optical axis (OpenCV).

    Target axes: x right and y up as the viewer sees them, z towards the viewer, origin in the tape's centre.
    """

    camera_from_target: npt.NDArray[np.float64]   # (4, 4) rigid transform
    focal_scale: float                # 1.0; a camera whose focal length is not what its calibration says has another
    brightness: float                 # 1.0 = nominal ring light on the tape


class Scene(Protocol):
    """The surroundings of a camera."""

    def view(self) -> View: ...


class Plant(Scene, Protocol):
    """The physical robot and its surroundings, advanced by whoever owns the clock."""

    motors: tuple[str, ...]           # "flywheel_a", "flywheel_b", "hood", "feeder"

    def advance(self, t_ns: int, torque_nm: Mapping[str, float]) -> None:
        """Bring the world to `t_ns` with these motor torques (missing = 0, released)."""

    def motor(self, name: str) -> MotorTruth: ...

    def bus_v(self) -> float:
        """Supply voltage at the motor drivers now."""

    def hood_encoder_rad(self) -> float:
        """Elevation above horizontal at the hood pivot's magnet, plus whatever is wrong with its mounting."""

    def hood_at_limit(self) -> bool:
        """The limit switch at the hood's lowest elevation is closed."""


NOTHING = View(np.diag([1.0, -1.0, -1.0, 1.0]), 1.0, 1.0)     # the target is at the lens: it is not drawn


class Stage:
    """As much of Plant as a camera looks at; whoever has it changes `now`."""

    def __init__(self, now: View) -> None:
        self.now = now

    def view(self) -> View:
        return self.now
