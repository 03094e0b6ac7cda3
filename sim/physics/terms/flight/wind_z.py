"""Air that rises or sinks."""

from truearc.sim.physics.term import SPEED, WindTerm, either_way, wind_speed


class WindZ(WindTerm):
    """The ball's velocity through the air is its own less speed_m_s upward."""

    order = 40, "what air the ball meets, before its forces"
    parameters = wind_speed("wind upward")
    direction = "vertical"
    label = "rising or sinking air"
    sentence = "The air rises or sinks where the balls fly."
    phrase = either_way("the air <rises|sinks> at {}", SPEED)
