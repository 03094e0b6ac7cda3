"""Drag that grows with the square of the spin."""

import math

from truearc.sim.physics.air import drag_per_m
from truearc.sim.physics.term import BallState, FlightTerm, Forces, Instrument, Rig, Values, Vec, amplitude, either_way
from truearc.sim.physics.vector import dot, length, scale, times


class SpinDrag(FlightTerm):
    """cd grows by share S^2 with S = 2 pi r spin / speed: a = -(share S^2) (rho A / 2 m) v^2 against the velocity."""

    order = 130, "a force by itself, which shares of drag leave alone"
    parameters = amplitude("share", "1", -2.0, 5.0, sd=0.3, meaning="growth of cd with the spin parameter squared",
                           source="seen of golf balls, baseballs and, in tunnels only, tennis balls (Cross & Lindsey "
                           "2013)",
                           reason="tunnel data of spinning balls rise by about as much as S squared")
    direction = "along"
    positive = 0.9                    # every tunnel that has looked found more drag with more spin
    label = "drag by spin"
    sentence = "The air slows a spinning ball more than one without spin."
    phrase = either_way("a spinning ball has <more|less> drag: its coefficient is {} <larger|smaller> where the ball's "
                        "rim turns as fast as it flies")
    instrument = Instrument("shots_without_spin", "where five shots without spin go", 0.15)

    def acceleration(self, rig: Rig, values: Values, ball: BallState, forces: Forces) -> Vec:
        rim_m = 2.0 * math.pi * rig.ball.radius_m
        per_m = values["share"] * (drag_per_m(rig) * rim_m**2)
        pace = dot(ball.spin_rev_s, ball.spin_rev_s) / length(ball.velocity_m_s)
        return scale(times(-1.0, times(per_m, pace)), ball.velocity_m_s)
