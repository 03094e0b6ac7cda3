"""A tracker whose metre changes with height: it looks up or down at the flight, as on a film from the ground."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.sim.physics.term import Parameter, Prior, WatchTerm
from truearc.sim.physics.vector import Vec, times


@final
@dataclass(frozen=True)
class TrackPerspective(WatchTerm):
    """seen position = position x (1 + per_m x height above the floor), to first order; negative: shrinks upward."""

    name: ClassVar[str] = "track_perspective"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("per_m", "1/m", -0.1, 0.1, 0.0, "a camera that looks up at an angle a from D metres away sees what "
                  "is 1 m higher sin(a) m farther off, and smaller by sin(a) / D",
                  Prior("linear", 0.0, 0.01, "a tripod 5 m away whose camera is pitched by three degrees")),)
    symmetry: ClassVar[str] = "none"
    sentence: ClassVar[str] = "The tracker's metre changes with height: it looks up or down at the flight."

    def watch(self, values: Mapping[str, Any], position_m: Vec, velocity_m_s: Vec, time_s: Any) -> Vec:
        longer = times(values["per_m"], position_m.z)
        return Vec(*(part + times(longer, part) for part in position_m))
