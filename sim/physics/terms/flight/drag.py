"""Quadratic air drag (the seed's Eq. 3)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.term import BallState, FlightTerm, Parameter, Prior
from truearc.sim.physics.vector import Vec, length, scale


@final
@dataclass(frozen=True)
class Drag(FlightTerm):
    """F = (cd / 2) A rho v^2 against the velocity, with A = pi r^2."""

    name: ClassVar[str] = "drag"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("cd", "1", 0.0, 5.0, 0.0, "the seed's search range; a smooth sphere has 0.4-0.5",
                  Prior("log", 0.5, 0.7, "spheres and sports balls have 0.1 (past the drag crisis) to 0.7 (felt); a "
                                         "factor of two either way leaves room for the seed's 0.91")),)
    symmetry: ClassVar[str] = "any"
    sentence: ClassVar[str] = "The air slows the ball in proportion to the square of its speed."

    def acceleration(self, facts: Rig, values: Mapping[str, Any], ball: BallState,
                     forces: Mapping[str, Vec]) -> Vec:
        area_m2 = math.pi * facts.ball.radius_m**2
        per_m = values["cd"] * (0.5 * area_m2 * facts.air.density_kg_m3 / facts.ball.mass_kg)
        return scale(-per_m * length(ball.velocity_m_s), ball.velocity_m_s)
