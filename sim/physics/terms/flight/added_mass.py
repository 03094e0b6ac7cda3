"""The ball drags air along: it is harder to accelerate than its mass says."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.term import BallState, FlightTerm, Parameter, Prior
from truearc.sim.physics.vector import Vec, add, scale


@final
@dataclass(frozen=True)
class AddedMass(FlightTerm):
    """All accelerations / (1 + share x rho V / 2 m): half the displaced air for a sphere in potential flow."""

    name: ClassVar[str] = "added_mass"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("share", "1", -1.0, 4.0, 0.0, "1 for a sphere in a fluid without friction: half of the displaced "
                  "mass (Lamb, Hydrodynamics)",
                  Prior("linear", 0.0, 1.0, "0 is a simulation without it, 1 is the theory")),)
    symmetry: ClassVar[str] = "any"
    sentence: ClassVar[str] = "The ball carries air along and is harder to speed up or slow down than its mass says."

    def acceleration(self, facts: Rig, values: Mapping[str, Any], ball: BallState,
                     forces: Mapping[str, Vec]) -> Vec:
        volume_m3 = 4.0 / 3.0 * math.pi * facts.ball.radius_m**3
        heavier = values["share"] * (0.5 * facts.air.density_kg_m3 * volume_m3 / facts.ball.mass_kg)
        total = Vec(0.0, 0.0, 0.0)
        for force in forces.values():
            total = add(total, force)
        return scale(-heavier / (1.0 + heavier), total)
