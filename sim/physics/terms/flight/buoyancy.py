"""The ball floats a little: the air that it displaces carries it."""

import math

from truearc.sim.physics.term import BallState, FlightTerm, Forces, Rig, Values, Vec
from truearc.sim.physics.term_fields import SHARE, Instrument, Parameter, Phrase, Prior


class Buoyancy(FlightTerm):
    """share x (rho V / m) g upward, Archimedes' force; 1 is all of it."""

    order = 190, "air at rest: after the shares of the moving air's forces"
    parameters = (Parameter(
        "share", "1", -1.0, 4.0, 0.0, "1 by Archimedes' principle: 2.5 % of the weight of a foam ball",
        Prior("linear", 0.0, 1.0, "0 is a simulation without it, 1 is what it must be"),
        meaning="part of the displaced air's weight that lifts the ball"),)
    direction = "vertical"
    symmetry = "vertical"
    sentence = "The air that the ball displaces carries part of its weight."
    phrase = Phrase("the air carries part of the ball's weight, {} of that of the air it displaces",
                    "the ball is heavier than stated, by {} of the weight of the air it displaces", *SHARE)
    instrument = Instrument("ball_scale", "ball mass with a scale", 0.3)

    def acceleration(self, facts: Rig, values: Values, ball: BallState, forces: Forces) -> Vec:
        volume_m3 = 4.0 / 3.0 * math.pi * facts.ball.radius_m**3
        lighter = facts.air.density_kg_m3 * volume_m3 / facts.ball.mass_kg
        return Vec(0.0, 0.0, values["share"] * (lighter * facts.world.gravity_m_s2))
