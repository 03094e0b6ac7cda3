"""A tracker whose clock runs fast or slow: frames that come at another rate than stated."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.sim.physics.term import Parameter, Prior, WatchTerm
from truearc.sim.physics.vector import Vec, plus, times


@final
@dataclass(frozen=True)
class TrackClock(WatchTerm):
    """At t of its clock the ball is where it is at t (1 + share): position + velocity x share x t, to first order."""

    name: ClassVar[str] = "track_clock"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("share", "1", -0.08, 0.08, 0.0, "cheap cameras state 30 frames a second and give 29.97, or drop some "
                  "without saying",
                  Prior("linear", 0.0, 0.01, "stated and true frame rates of cameras differ by up to a per cent or "
                        "so")),)
    symmetry: ClassVar[str] = "any"
    sentence: ClassVar[str] = "The tracker's clock runs fast or slow: its frames come at another rate than stated."

    def watch(self, values: Mapping[str, Any], position_m: Vec, velocity_m_s: Vec, time_s: Any) -> Vec:
        late_s = values["share"] * time_s
        return Vec(*(plus(place, times(late_s, speed)) for place, speed in zip(position_m, velocity_m_s, strict=True)))
