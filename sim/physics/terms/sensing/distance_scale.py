"""A camera that takes all distances as too long or too short by the same share."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.launch import Exit
from truearc.sim.physics.term import Parameter, Prior, SensingTerm


@final
@dataclass(frozen=True)
class DistanceScale(SensingTerm):
    """true distance = measured x (1 + share)."""

    name: ClassVar[str] = "distance_scale"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("share", "1", -0.3, 0.3, 0.0, "a focal length or a target size that is off by a per cent puts every "
                  "distance off by it",
                  Prior("linear", 0.0, 0.02, "calibrations of the focal length repeat to about a per cent, and so do "
                        "printed targets")),)
    symmetry: ClassVar[str] = "any"
    sentence: ClassVar[str] = "The robot takes all distances as too long or too short by the same share."

    def sense(self, facts: Rig, values: Mapping[str, Any], exit: Exit, distance_m: Any) -> tuple[Exit, Any]:
        return exit, distance_m * (1.0 + values["share"])
