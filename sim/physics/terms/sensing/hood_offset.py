"""A hood that stands at another angle than it reads, by the same angle everywhere."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.launch import Exit
from truearc.sim.physics.term import Parameter, Prior, SensingTerm


@final
@dataclass(frozen=True)
class HoodOffset(SensingTerm):
    """true elevation = measured + angle_deg."""

    name: ClassVar[str] = "hood_offset"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("angle_deg", "deg", -10.0, 10.0, 0.0, "a zero set by eye or by a hard stop is a degree off as often "
                  "as not",
                  Prior("linear", 0.0, 1.0, "a zero set with a digital level is good to a few tenths of a degree, "
                        "one set by eye to one or two")),)
    symmetry: ClassVar[str] = "none"
    sentence: ClassVar[str] = "The hood stands at another angle than it reads, by the same angle at every setting."

    def sense(self, facts: Rig, values: Mapping[str, Any], exit: Exit, distance_m: Any) -> tuple[Exit, Any]:
        return exit._replace(elevation_rad=exit.elevation_rad + math.radians(1.0) * values["angle_deg"]), distance_m
