"""Lift that grows more slowly the faster the ball spins."""

import math

import jax.numpy as jnp

from truearc.sim.physics.term import BallState, FlightTerm, Forces, Rig, Values, Vec
from truearc.sim.physics.term_fields import NUMBER, Instrument, Parameter, Phrase, Prior
from truearc.sim.physics.vector import length, scale

LEAST = 0.1                           # of 1 + rate S, should a search try rates far below 0


class LiftSaturation(FlightTerm):
    """Lift / (1 + rate S) with S = 2 pi r spin / speed."""

    order = 150, "a share of the lift"
    parameters = (Parameter(
        "rate", "1", 0.0, 10.0, 0.0, "lift of baseballs depends on S alone and flattens with it (Nathan 2008)",
        Prior("linear", 0.0, 1.0, "tunnel data of sports balls flatten at S of about 0.3 to 1"),
        meaning="how soon the lift levels off with the spin parameter"),)
    direction = "vertical"
    symmetry = "any"
    sentence = "The lift no longer grows in proportion to the spin when the ball spins fast."
    phrase = Phrase("lift levels off as the ball spins faster, at a rate of {}", "lift grows more than in proportion "
                    "to spin, at a rate of {}", *NUMBER)
    instrument = Instrument("spin_film", "spin of a marked ball at 120 frames/s", 0.3)

    def acceleration(self, facts: Rig, values: Values, ball: BallState, forces: Forces) -> Vec:
        if "magnus" not in forces:
            return Vec(0.0, 0.0, 0.0)
        bend_m_s = values["rate"] * (2.0 * math.pi * facts.ball.radius_m) * length(ball.spin_rev_s)
        speed_m_s = length(ball.velocity_m_s)
        return scale(-bend_m_s / jnp.maximum(speed_m_s + bend_m_s, LEAST * speed_m_s), forces["magnus"])
