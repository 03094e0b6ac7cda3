"""A distance that is as old as the picture it came from, while the robot moves."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.launch import Exit
from truearc.sim.physics.term import Parameter, Prior, SensingTerm


@final
@dataclass(frozen=True)
class VisionLatency(SensingTerm):
    """true distance = measured - delay_s x closing speed; the effective value is that product, in m."""

    name: ClassVar[str] = "vision_latency"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("delay_s", "s", 0.0, 0.5, 0.0, "vision pipelines of robots take 30 to 50 ms from light to distance",
                  Prior("linear", 0.0, 0.05, "20 to 80 ms are usual, exposure and network included")),)
    symmetry: ClassVar[str] = "none"
    sentence: ClassVar[str] = ("The distance is out of date by the time of the shot: the robot has driven on since the "
                               "picture was taken.")
    follows: ClassVar[str | None] = "closing_speed_m_s"

    def sense(self, facts: Rig, values: Mapping[str, Any], exit: Exit, distance_m: Any) -> tuple[Exit, Any]:
        return exit, distance_m - values["delay_s"]
