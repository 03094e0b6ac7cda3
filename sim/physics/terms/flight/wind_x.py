"""Air that moves toward the target, or away from it."""

from truearc.sim.physics.term import SPEED, WindTerm, either_way, wind_speed


class WindX(WindTerm):
    """The ball's velocity through the air is its own less speed_m_s toward the target."""

    order = 20, "what air the ball meets, before its forces"
    parameters = wind_speed("wind toward the target")
    direction = "along"
    label = "head or tail wind"
    sentence = "There is wind toward the target, or from it."
    phrase = either_way("there is wind of {} <toward|from> the target", SPEED)
