"""A tracker whose horizon is not level."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

import jax.numpy as jnp

from truearc.sim.physics.term import Parameter, Prior, WatchTerm
from truearc.sim.physics.vector import Vec


@final
@dataclass(frozen=True)
class TrackTilt(WatchTerm):
    """Positions are seen turned about the left axis on the floor below the exit; positive: higher, what lies ahead."""

    name: ClassVar[str] = "track_tilt"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("angle_deg", "deg", -15.0, 15.0, 0.0, "a camera on a tripod is levelled by eye or by a bubble",
                  Prior("linear", 0.0, 1.0, "a bubble is good to half a degree, the eye to one or two")),)
    symmetry: ClassVar[str] = "none"
    sentence: ClassVar[str] = "The tracker is tilted: what lies ahead seems higher or lower than it is."

    def watch(self, values: Mapping[str, Any], position_m: Vec, velocity_m_s: Vec, time_s: Any) -> Vec:
        angle_rad = math.radians(1.0) * values["angle_deg"]
        cosine, sine = jnp.cos(angle_rad), jnp.sin(angle_rad)
        x, z = position_m.x, position_m.z
        return Vec(x * cosine - z * sine, position_m.y, z * cosine + x * sine)
