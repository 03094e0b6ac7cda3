"""Air that rises or sinks."""

from truearc.sim.physics.term import SPEED, Instrument, Parameter, Prior, WindTerm, either_way


class WindZ(WindTerm):
    """The ball's velocity through the air is its own less speed_m_s upward."""

    order = 40, "what air the ball meets, before its forces"
    parameters = (Parameter(
        "speed_m_s", "m/s", -10.0, 10.0, 0.0, "halls have draughts of 0.1 to 0.3 m/s, fields winds of 1 to 3 m/s",
        Prior("linear", 0.0, 0.8, "a hall's draught to a light breeze; more would be felt"), meaning="wind upward"),)
    axis = "z"
    direction = "vertical"
    symmetry = "vertical"
    label = "rising or sinking air"
    sentence = "The air rises or sinks where the balls fly."
    phrase = either_way("the air <way> at {}", "rises", "sinks", SPEED)
    instrument = Instrument("the wind with an anemometer", 0.2)
