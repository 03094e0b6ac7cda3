"""A camera that takes all distances as too long or too short by the same length."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.launch import Exit
from truearc.sim.physics.term import Parameter, Prior, SensingTerm


@final
@dataclass(frozen=True)
class DistanceBias(SensingTerm):
    """true distance = measured + bias_m."""

    name: ClassVar[str] = "distance_bias"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("bias_m", "m", -1.0, 1.0, 0.0, "the camera, the exit and the plane of the target are not where the "
                  "drawing has them",
                  Prior("linear", 0.0, 0.05, "a mount, a lens and a target are each within a few centimetres of the "
                        "drawing")),)
    symmetry: ClassVar[str] = "any"
    sentence: ClassVar[str] = "The robot takes all distances as too long or too short by the same length."

    def sense(self, facts: Rig, values: Mapping[str, Any], exit: Exit, distance_m: Any) -> tuple[Exit, Any]:
        return exit, distance_m + values["bias_m"]
