"""The ball drags air along: it is harder to accelerate than its mass says."""

from truearc.sim.physics.air import displaced_share
from truearc.sim.physics.term import BallState, FlightTerm, Forces, Rig, Values, Vec
from truearc.sim.physics.term_fields import SHARE, Instrument, Phrase, amplitude
from truearc.sim.physics.vector import scale, total


class AddedMass(FlightTerm):
    """All accelerations / (1 + share x rho V / 2 m): half the displaced air for a sphere in potential flow."""

    order = 200, "a share of all forces"
    parameters = amplitude("share", "1", -1.0, 4.0, sd=1.0, meaning="share of half the displaced mass that moves along",
                           source="1 for a sphere in a fluid without friction: half the displaced mass (Lamb 1932)",
                           reason="0 is a simulation without it, 1 is the theory")
    direction = "vertical"
    law_sd = 0.2
    sentence = "The ball carries air along and is harder to speed up or slow down than its mass says."
    phrase = Phrase("the ball has to move some air along, {} of what theory gives it", "the ball moves as if it were "
                    "lighter, by {} of the air that theory has it move along", *SHARE)
    instrument = Instrument("ball_scale", "ball mass with a scale", 0.3)

    def acceleration(self, rig: Rig, values: Values, ball: BallState, forces: Forces) -> Vec:
        heavier = values["share"] * (0.5 * displaced_share(rig))
        return scale(-heavier / (1.0 + heavier), total(forces.values()))
