"""Lift of a spinning ball (the seed's Eq. 2)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.term import BallState, FlightTerm, Parameter, Prior
from truearc.sim.physics.vector import Vec, cross, scale


@final
@dataclass(frozen=True)
class Magnus(FlightTerm):
    """F = cl (4/3) (4 pi^2 r^3 rho) s x v with s in revolutions per second: backspin lifts."""

    name: ClassVar[str] = "magnus"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("cl", "1", 0.0, 5.0, 0.0, "the seed's search range; 1 is the inviscid value",
                  Prior("linear", 0.1, 0.15, "a lift of k r w / v in the usual form, k near 0.5 to 1, is cl 0.1 to 0.2 "
                                             "with a true spin and half of that with the seed's, which is twice as "
                                             "fast; smooth balls may have it reversed")),)
    symmetry: ClassVar[str] = "any"
    sentence: ClassVar[str] = "The ball's spin bends its path, in proportion to spin and speed."

    def acceleration(self, facts: Rig, values: Mapping[str, Any], ball: BallState,
                     forces: Mapping[str, Vec]) -> Vec:
        per_rev = 4.0 / 3.0 * 4.0 * math.pi**2 * facts.ball.radius_m**3 * facts.air.density_kg_m3 / facts.ball.mass_kg
        return scale(values["cl"] * per_rev, cross(ball.spin_rev_s, ball.velocity_m_s))
