"""Weight (the paper's Eq. 1)."""

from truearc.sim.physics.term import SHARE, BallState, FlightTerm, Forces, Parameter, Rig, Values, Vec, either_way


class Gravity(FlightTerm):
    """a = -g in z; `scale` multiplies the rig's own g and is 1 unless a fit says otherwise."""

    order = 100, "the one force that is not the air's"
    parameters = (Parameter("scale", "1", 0.0, 2.0, 1.0, "1 by definition; rig.toml states g",
                            meaning="gravity as a multiple of the stated one"),)
    direction = "vertical"
    always = True
    sentence = "The ball falls under its weight."
    phrase = either_way("the ball <falls|rises> with {} of the stated gravity", SHARE)
    instrument = None

    def acceleration(self, rig: Rig, values: Values, ball: BallState, forces: Forces) -> Vec:
        return Vec(0.0, 0.0, -rig.world.gravity_m_s2 * values["scale"])
