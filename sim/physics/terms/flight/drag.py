"""Quadratic air drag (the paper's Eq. 3)."""

from truearc.sim.physics.air import drag_per_m
from truearc.sim.physics.term import BallState, FlightTerm, Forces, Instrument, Rig, Values, Vec, amplitude, either_way
from truearc.sim.physics.vector import length, scale


class Drag(FlightTerm):
    """F = (cd / 2) A rho v^2 against the velocity, with A = pi r^2."""

    order = 110, "a force by itself, before those that are shares of it"
    parameters = amplitude("cd", "1", 0.0, 5.0, scale="log", centre=0.5, sd=0.35, meaning="drag coefficient",
                           source="spheres at the speeds of launchers: 0.4 to 0.5 smooth (Achenbach 1972), 0.5 to 0.65 "
                           "felt (Mehta et al. 2008); range: the paper's search",
                           reason="a factor of 1.4 either way holds these; the paper's 0.91 is two deviations off",
                           by_ball=0.08, fit_each_ball=True)
    direction = "along"
    sentence = "The air slows the ball in proportion to the square of its speed."
    phrase = either_way("the air <slows|drives> the ball, with a drag coefficient of <|minus >{}")
    instrument = Instrument("fall_film", "the fall of a ball from a known height", 0.05, True)

    def acceleration(self, rig: Rig, values: Values, ball: BallState, forces: Forces) -> Vec:
        return scale(-values["cd"] * drag_per_m(rig) * length(ball.velocity_m_s), ball.velocity_m_s)
