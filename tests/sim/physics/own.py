"""A term of a user's own, such as tests add to the catalogue."""

import math

from truearc.sim.physics.term import ANGLE, Exit, Instrument, LaunchTerm, Parameter, Prior, Rig, Values, either_way


class Flex(LaunchTerm):
    """true elevation = measured - angle_deg."""

    order = 5, "before the losses"
    parameters = (Parameter("angle_deg", "deg", -5.0, 5.0, 0.0, "made up for the tests",
                            Prior("linear", 0.0, 1.0, "made up for the tests"), meaning="the angle it yields by"),)
    direction = "vertical"
    label = "yielding hood"
    sentence = "The hood yields to the ball."
    phrase = either_way("the hood yields {} <down|up>", ANGLE)
    instrument = Instrument("hood_film", "hood angle on film", 0.3)

    def leave(self, rig: Rig, values: Values, exit: Exit) -> Exit:
        return exit._replace(elevation_rad=exit.elevation_rad - math.radians(1.0) * values["angle_deg"])
