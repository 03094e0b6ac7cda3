"""The ball floats a little: the air that it displaces carries it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.term import BallState, FlightTerm, Parameter, Prior
from truearc.sim.physics.vector import Vec


@final
@dataclass(frozen=True)
class Buoyancy(FlightTerm):
    """share x (rho V / m) g upward, Archimedes' force; 1 is all of it."""

    name: ClassVar[str] = "buoyancy"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("share", "1", -1.0, 4.0, 0.0, "1 by Archimedes' principle: 2.5 % of the weight of a foam ball",
                  Prior("linear", 0.0, 1.0, "0 is a simulation without it, 1 is what it must be")),)
    symmetry: ClassVar[str] = "vertical"
    sentence: ClassVar[str] = "The air that the ball displaces carries part of its weight."

    def acceleration(self, facts: Rig, values: Mapping[str, Any], ball: BallState,
                     forces: Mapping[str, Vec]) -> Vec:
        volume_m3 = 4.0 / 3.0 * math.pi * facts.ball.radius_m**3
        lighter = facts.air.density_kg_m3 * volume_m3 / facts.ball.mass_kg
        return Vec(0.0, 0.0, values["share"] * (lighter * facts.world.gravity_m_s2))
