"""Weather: thin air pushes less than dense air."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.term import BallState, FlightTerm, Parameter, Prior
from truearc.sim.physics.vector import Vec, add, scale

NOT_OF_AIR = ("gravity",)             # among the terms before this one in the catalogue


@final
@dataclass(frozen=True)
class AirDensity(FlightTerm):
    """All forces of the air x (1 + share x density's known departure from its median)."""

    name: ClassVar[str] = "air_density"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("share", "1", 0.0, 2.0, 0.0, "1 by definition: forces of the air are proportional to its density, "
                  "3.4 % for 10 K",
                  Prior("linear", 0.0, 1.0, "0 is a simulation that knows no weather, 1 the ideal gas")),)
    symmetry: ClassVar[str] = "any"
    sentence: ClassVar[str] = "The forces of the air change with its pressure and temperature."
    follows: ClassVar[str | None] = "density"

    def acceleration(self, facts: Rig, values: Mapping[str, Any], ball: BallState,
                     forces: Mapping[str, Vec]) -> Vec:
        return share_of_air(values["share"], forces)


def share_of_air(share: Any, forces: Mapping[str, Vec]) -> Vec:
    """That share of the forces of the air among these."""
    total = Vec(0.0, 0.0, 0.0)
    for name, force in forces.items():
        if name not in NOT_OF_AIR:
            total = add(total, scale(share, force))
    return total
