"""Air that moves across the flight."""

from truearc.sim.physics.term import SPEED, Instrument, Parameter, Prior, WindTerm, either_way


class WindY(WindTerm):
    """The ball's velocity through the air is its own less speed_m_s to the left."""

    order = 30, "what air the ball meets, before its forces"
    parameters = (Parameter(
        "speed_m_s", "m/s", -10.0, 10.0, 0.0, "halls have draughts of 0.1 to 0.3 m/s, fields winds of 1 to 3 m/s",
        Prior("linear", 0.0, 0.8, "a hall's draught to a light breeze; more would be felt"),
        meaning="wind to the left"),)
    axis = "y"
    direction = "lateral"
    symmetry = "none"
    label = "crosswind"
    record = "tracks of the ball"
    sentence = "There is wind across the flight."
    phrase = either_way("there is wind of {} to the <way>", "left", "right", SPEED)
    instrument = Instrument("the wind with an anemometer", 0.2)
