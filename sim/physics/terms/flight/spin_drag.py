"""Drag that grows with the square of the spin."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.term import BallState, FlightTerm, Parameter, Prior
from truearc.sim.physics.vector import Vec, dot, length, scale, times


@final
@dataclass(frozen=True)
class SpinDrag(FlightTerm):
    """cd grows by share S^2 with S = 2 pi r spin / speed: a = -(share S^2) (rho A / 2 m) v^2 against the velocity."""

    name: ClassVar[str] = "spin_drag"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("share", "1", -2.0, 5.0, 0.0, "golf balls and baseballs have it; tennis balls in the tunnel, though "
                  "not in free flight (Cross & Lindsey 2013)",
                  Prior("linear", 0.0, 0.3, "tunnel data of spinning balls rise by about as much as S squared")),)
    symmetry: ClassVar[str] = "any"
    sentence: ClassVar[str] = "The air slows a spinning ball more than one without spin."

    def acceleration(self, facts: Rig, values: Mapping[str, Any], ball: BallState,
                     forces: Mapping[str, Vec]) -> Vec:
        rim_m_s = 2.0 * math.pi * facts.ball.radius_m
        area_m2 = math.pi * facts.ball.radius_m**2
        per_m = values["share"] * (0.5 * area_m2 * facts.air.density_kg_m3 / facts.ball.mass_kg * rim_m_s**2)
        pace = dot(ball.spin_rev_s, ball.spin_rev_s) / length(ball.velocity_m_s)
        return scale(times(-1.0, times(per_m, pace)), ball.velocity_m_s)
