"""Air that moves toward the target, or away from it."""

from truearc.sim.physics.term import SPEED, Instrument, Parameter, Prior, WindTerm, either_way


class WindX(WindTerm):
    """The ball's velocity through the air is its own less speed_m_s toward the target."""

    order = 20, "what air the ball meets, before its forces"
    parameters = (Parameter(
        "speed_m_s", "m/s", -10.0, 10.0, 0.0, "halls have draughts of 0.1 to 0.3 m/s, fields winds of 1 to 3 m/s",
        Prior("linear", 0.0, 0.8, "a hall's draught to a light breeze; more would be felt"),
        meaning="wind toward the target"),)
    axis = "x"
    direction = "along"
    symmetry = "none"
    label = "head or tail wind"
    sentence = "There is wind toward the target, or from it."
    phrase = either_way("there is wind of {} <way> the target", "toward", "from", SPEED)
    instrument = Instrument("the wind with an anemometer", 0.2)
