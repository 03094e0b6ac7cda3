"""Play in the hood: where it stands depends on the side from which it came."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.launch import Exit
from truearc.sim.physics.term import Parameter, Prior, SensingTerm


@final
@dataclass(frozen=True)
class HoodBacklash(SensingTerm):
    """true elevation = measured + angle_deg x (+1 after moving up, -1 after moving down, 0 where that is not known)."""

    name: ClassVar[str] = "hood_backlash"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("angle_deg", "deg", -5.0, 5.0, 0.0, "gears and chains of robot hoods have half a degree to a degree "
                  "of play",
                  Prior("linear", 0.0, 0.7, "a tooth of a 20-pitch gear rack has about as much play as this; a "
                        "spring that takes it up leaves none")),)
    symmetry: ClassVar[str] = "none"
    sentence: ClassVar[str] = ("The hood has play: after moving up it stands at another angle than after moving down "
                               "to the same reading.")
    follows: ClassVar[str | None] = "hood_change"

    def sense(self, facts: Rig, values: Mapping[str, Any], exit: Exit, distance_m: Any) -> tuple[Exit, Any]:
        return exit._replace(elevation_rad=exit.elevation_rad + math.radians(1.0) * values["angle_deg"]), distance_m
