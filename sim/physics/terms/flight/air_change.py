"""Air that is not what it was when the believed coefficients were fitted: another season, another place."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.term import BallState, FlightTerm, Parameter, Prior
from truearc.sim.physics.terms.flight.air_density import share_of_air
from truearc.sim.physics.vector import Vec


@final
@dataclass(frozen=True)
class AirChange(FlightTerm):
    """All forces of the air x (1 + share). Fitted drag and lift take that up whole, unless both were known before."""

    name: ClassVar[str] = "air_change"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("share", "1", -0.5, 1.0, 0.0, "forces of the air are proportional to its density: 3.4 % for 10 K, "
                  "12 % for 1000 m of altitude",
                  Prior("linear", 0.0, 0.08, "from a cold hall to a hot one, or from the coast to the hills")),)
    symmetry: ClassVar[str] = "any"
    sentence: ClassVar[str] = "The air is denser or thinner than when the simulation was fitted."
    relative: ClassVar[bool] = True

    def acceleration(self, facts: Rig, values: Mapping[str, Any], ball: BallState,
                     forces: Mapping[str, Vec]) -> Vec:
        return share_of_air(values["share"], forces)
