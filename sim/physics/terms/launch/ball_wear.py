"""Balls that wear in the course of a session, and so leave slower."""

from truearc.sim.physics.term import SHARE, Instrument, SpeedTerm, amplitude, either_way


class BallWear(SpeedTerm):
    """exit speed x (1 - loss x age); age runs from 0 to 1 through the session, or through a ball's own shots."""

    order = 50, "a factor of the speed; these commute"
    parameters = amplitude("loss", "1", -0.5, 0.5, sd=0.03, meaning="share of the speed lost by the end of a session",
                           source="balls of a season are visibly smaller and torn at its end",
                           reason="none to five per cent of exit speed in a session")
    follows = "age"
    sentence = "The balls leave slower, or faster, the more they have been shot."
    phrase = either_way("the balls leave <slower|faster> the more they have been shot: {} by the end", SHARE)
    instrument = Instrument("speed_worn_balls", "the speed of new and worn balls in turn", 0.02)
