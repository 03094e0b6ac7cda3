"""A drag coefficient that changes with speed (the Reynolds number of a given ball)."""

from truearc.sim.physics.term import BallState, ForceShareTerm, Number, Rig, Values
from truearc.sim.physics.term_fields import SHARE, Instrument, Parameter, amplitude, either_way
from truearc.sim.physics.vector import length


class DragReynolds(ForceShareTerm):
    """cd x (1 + slope (v / at_m_s - 1)): cd is the coefficient at at_m_s."""

    of = "drag"
    order = 140, "a share of drag"
    parameters = (
        *amplitude("slope", "1", -1.0, 1.0, sd=0.3, meaning="relative change of drag coefficient per relative speed",
                   source="cd falls from 0.5 to 0.1-0.2 as rough balls pass Re 1e5-3e5 (Hong 2020); tennis balls keep "
                   "theirs",
                   reason="a ball of 18 cm at 8 to 15 m/s is just below that fall or at its foot"),
        Parameter("at_m_s", "m/s", 1.0, 30.0, 10.0, "a usual exit speed; it only says where cd is meant",
                  meaning="speed at which the drag coefficient is stated"))
    direction = "along"
    label = "drag by speed"
    sentence = "The drag coefficient changes with the ball's speed."
    phrase = either_way("the drag coefficient <grows|falls> with speed, by {} from 10 to 20 m/s", SHARE, " per 10 m/s")
    instrument = Instrument("fall_film_two_heights", "the fall of a ball from two heights", 0.2, True)

    def share(self, rig: Rig, values: Values, ball: BallState) -> Number:
        return values["slope"] * (length(ball.velocity_m_s) / values["at_m_s"] - 1.0)
