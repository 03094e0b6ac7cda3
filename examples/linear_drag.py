"""Air drag proportional to speed: a deliberately wrong drag law for a simulation to believe.

truearc discover drops/ --terms-from examples/linear_drag.py --believe gravity,linear_drag
"""

from truearc.sim.physics.term import (
    BallState,
    FlightTerm,
    Forces,
    Instrument,
    Rig,
    Values,
    Vec,
    amplitude,
    either_way,
    scale,
)
from truearc.sim.physics.terms.flight import drag_per_m


class LinearDrag(FlightTerm):
    """F = (cd_m_s / 2) A rho v against the velocity, with A = pi r^2: a drag coefficient of cd_m_s / v."""

    order = 115, "a force by itself, like drag"
    parameters = amplitude("cd_m_s", "m/s", 0.0, 100.0, scale="log", centre=5.0, sd=0.7,
                           meaning="drag coefficient times speed",
                           source="a drag coefficient of 0.5 at 10 m/s, and twenty times that",
                           reason="a factor of two either way holds foam balls at 5 to 20 m/s")
    direction = "along"
    sentence = "The air slows the ball in proportion to its speed."
    phrase = either_way("the air <slows|drives> the ball in proportion to its speed, as a drag coefficient of {} would "
                        "at 1 m/s")
    instrument = Instrument("fall_film_two_heights", "the fall of a ball from two heights", 1.0, True)

    def acceleration(self, rig: Rig, values: Values, ball: BallState, forces: Forces) -> Vec:
        return scale(-values["cd_m_s"] * drag_per_m(rig), ball.velocity_m_s)
