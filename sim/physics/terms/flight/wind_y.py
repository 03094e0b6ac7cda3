"""Air that moves across the flight."""

from truearc.sim.physics.term import SPEED, WindTerm, either_way, wind_speed


class WindY(WindTerm):
    """The ball's velocity through the air is its own less speed_m_s to the left."""

    order = 30, "what air the ball meets, before its forces"
    parameters = wind_speed("wind to the left")
    direction = "lateral"
    label = "crosswind"
    record = "tracks of the ball"
    sentence = "There is wind across the flight."
    phrase = either_way("there is wind of {} to the <left|right>", SPEED)
