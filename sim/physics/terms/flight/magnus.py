"""Lift of a spinning ball (the paper's Eq. 2)."""

import math

from truearc.sim.physics.term import BallState, FlightTerm, Forces, Instrument, Rig, Values, Vec, amplitude, either_way
from truearc.sim.physics.vector import cross, scale


class Magnus(FlightTerm):
    """F = cl (4/3) (4 pi^2 r^3 rho) s x v with s in revolutions per second: backspin lifts."""

    order = 120, "a force by itself, before those that are shares of it"
    parameters = amplitude("cl", "1", 0.0, 5.0, scale="linear", centre=0.1, sd=0.15, meaning="lift coefficient",
                           source="the paper's search range; 1 is the inviscid value",
                           reason="a lift of k r w / v in the usual form, k near 0.5 to 1, is cl 0.1 to 0.2 with the "
                           "true spin, half of that with the paper's (twice as fast); smooth balls may reverse it",
                           by_ball=0.08)
    direction = "vertical"
    label = "lift"
    sentence = "The ball's spin bends its path, in proportion to spin and speed."
    phrase = either_way("backspin <lifts the ball|presses the ball down>, with a lift coefficient of <|minus >{}")
    topspin_phrase = either_way("topspin <presses the ball down|lifts the ball>, with a lift coefficient of "
                                "<|minus >{}")
    instrument = Instrument("shots_without_spin", "where five shots without spin go", 0.05)

    def acceleration(self, rig: Rig, values: Values, ball: BallState, forces: Forces) -> Vec:
        per_rev = 4.0 / 3.0 * 4.0 * math.pi**2 * rig.ball.radius_m**3 * rig.air.density_kg_m3 / rig.ball.mass_kg
        return scale(values["cl"] * per_rev, cross(ball.spin_rev_s, ball.velocity_m_s))
