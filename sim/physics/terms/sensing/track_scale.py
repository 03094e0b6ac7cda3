"""A tracker whose metre is too long or too short."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.sim.physics.term import Parameter, Prior, WatchTerm
from truearc.sim.physics.vector import Vec, times


@final
@dataclass(frozen=True)
class TrackScale(WatchTerm):
    """seen position = position x (1 + share), from the floor below the exit."""

    name: ClassVar[str] = "track_scale"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("share", "1", -0.1, 0.1, 0.0, "pixels become metres by a scale measured once, in one plane; nearer "
                  "balls look larger",
                  Prior("linear", 0.0, 0.02, "a ball that flies a hand away from the plane of calibration is off by "
                        "a per cent or two")),)
    symmetry: ClassVar[str] = "any"
    sentence: ClassVar[str] = "The tracker takes all lengths as too long or too short by the same share."

    def watch(self, values: Mapping[str, Any], position_m: Vec, velocity_m_s: Vec, time_s: Any) -> Vec:
        return Vec(*(part + times(values["share"], part) for part in position_m))
