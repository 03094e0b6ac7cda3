"""Balls whose drag changes as they wear."""

from truearc.sim.physics.term import BallState, FlightTerm, Forces, Rig, Values, Vec
from truearc.sim.physics.term_fields import SHARE, Instrument, Parameter, Prior, either_way
from truearc.sim.physics.vector import scale


class DragWear(FlightTerm):
    """drag x (1 + share x age); age runs from 0 to 1 through the session, or through a ball's own shots."""

    order = 160, "a share of drag"
    parameters = (Parameter(
        "share", "1", -0.9, 2.0, 0.0, "worn tennis balls have clearly less drag than new ones (Goodwill 2004); torn "
        "foam has more",
        Prior("linear", 0.0, 0.1, "none to fifteen per cent in a session, in either direction"),
        meaning="relative growth of the drag by the end of a session"),)
    direction = "along"
    symmetry = "any"
    label = "drag of worn balls"
    follows = "age"
    record = "ball_id or t_s of each shot"
    sentence = "The drag of the balls changes the more they have been shot."
    phrase = either_way("the drag of the balls <way> the more they have been shot, by {} at the end", "grows", "falls",
                        SHARE)
    instrument = Instrument("fall_film_worn_balls", "the fall of new and worn balls side by side, on film", 0.05)

    def acceleration(self, facts: Rig, values: Values, ball: BallState, forces: Forces) -> Vec:
        return scale(values["share"], forces["drag"]) if "drag" in forces else Vec(0.0, 0.0, 0.0)
