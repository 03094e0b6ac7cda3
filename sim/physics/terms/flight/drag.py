"""Quadratic air drag (the paper's Eq. 3)."""

from truearc.sim.physics.air import drag_per_m
from truearc.sim.physics.term import BallState, FlightTerm, Forces, Instrument, Rig, Values, Vec, amplitude, either_way
from truearc.sim.physics.vector import length, scale


class Drag(FlightTerm):
    """F = (cd / 2) A rho v^2 against the velocity, with A = pi r^2."""

    order = 110, "a force by itself, before those that are shares of it"
    parameters = amplitude("cd", "1", 0.0, 5.0, scale="log", centre=0.5, sd=0.7, meaning="drag coefficient",
                           source="the paper's search range; a smooth sphere has 0.4-0.5",
                           reason="spheres and sports balls have 0.1 (past the drag crisis) to 0.7 (felt); a factor of "
                           "two either way leaves room for the paper's 0.91", by_ball=0.08, fit_each_ball=True)
    direction = "along"
    sentence = "The air slows the ball in proportion to the square of its speed."
    phrase = either_way("the air <slows|drives> the ball, with a drag coefficient of <|minus >{}")
    instrument = Instrument("fall_film", "the fall of a ball from a known height, on film", 0.05, True)

    def acceleration(self, rig: Rig, values: Values, ball: BallState, forces: Forces) -> Vec:
        return scale(-values["cd"] * drag_per_m(rig) * length(ball.velocity_m_s), ball.velocity_m_s)
