"""Lift that grows more slowly the faster the ball spins."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, final

import jax.numpy as jnp

from truearc.robot.config.rig_spec import Rig
from truearc.sim.physics.term import BallState, FlightTerm, Parameter, Prior
from truearc.sim.physics.vector import Vec, length, scale

LEAST = 0.1                           # of 1 + rate S, should a search try rates far below 0


@final
@dataclass(frozen=True)
class LiftSaturation(FlightTerm):
    """Lift / (1 + rate S) with S = 2 pi r spin / speed."""

    name: ClassVar[str] = "lift_saturation"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("rate", "1", 0.0, 10.0, 0.0, "lift of baseballs depends on S alone and flattens with it (Nathan "
                  "2008)",
                  Prior("linear", 0.0, 1.0, "tunnel data of sports balls flatten at S of about 0.3 to 1")),)
    symmetry: ClassVar[str] = "any"
    sentence: ClassVar[str] = "The lift no longer grows in proportion to the spin when the ball spins fast."

    def acceleration(self, facts: Rig, values: Mapping[str, Any], ball: BallState,
                     forces: Mapping[str, Vec]) -> Vec:
        if "magnus" not in forces:
            return Vec(0.0, 0.0, 0.0)
        bend_m_s = values["rate"] * (2.0 * math.pi * facts.ball.radius_m) * length(ball.spin_rev_s)
        speed_m_s = length(ball.velocity_m_s)
        return scale(-bend_m_s / jnp.maximum(speed_m_s + bend_m_s, LEAST * speed_m_s), forces["magnus"])
