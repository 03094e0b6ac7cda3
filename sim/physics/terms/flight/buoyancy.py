"""The ball floats a little: the air that it displaces carries it."""

from truearc.sim.physics.air import displaced_share
from truearc.sim.physics.term import BallState, FlightTerm, Forces, Rig, Values, Vec
from truearc.sim.physics.term_fields import SHARE, Instrument, Phrase, amplitude


class Buoyancy(FlightTerm):
    """share x (rho V / m) g upward, Archimedes' force; 1 is all of it."""

    order = 190, "air at rest: after the shares of the moving air's forces"
    parameters = amplitude("share", "1", -1.0, 4.0, sd=1.0, meaning="share of the displaced air's weight that lifts",
                           source="1 by Archimedes' principle: 2.5 % of the weight of a foam ball",
                           reason="0 is a simulation without it, 1 is what it must be")
    direction = "vertical"
    law_sd = 0.2
    sentence = "The air that the ball displaces carries part of its weight."
    phrase = Phrase("the air carries part of the ball's weight, {} of that of the air it displaces",
                    "the ball is heavier than stated, by {} of the weight of the air it displaces", *SHARE)
    instrument = Instrument("ball_scale", "ball mass with a scale", 0.3)

    def acceleration(self, rig: Rig, values: Values, ball: BallState, forces: Forces) -> Vec:
        return Vec(0.0, 0.0, values["share"] * (displaced_share(rig) * rig.world.gravity_m_s2))
