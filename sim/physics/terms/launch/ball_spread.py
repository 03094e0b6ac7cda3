"""Balls that differ: some leave always a little faster than others."""

from truearc.sim.physics.term import SHARE, Instrument, SpeedTerm, amplitude, either_way


class BallSpread(SpeedTerm):
    """exit speed x (1 + spread x the ball's own departure), a standard normal number that is not known."""

    sign = 1.0
    order = 60, "a factor of the speed; these commute"
    parameters = amplitude("spread", "1", 0.0, 0.3, sd=0.03, meaning="exit speed from ball to ball (sd)",
                           source="masses and stiffnesses of like balls differ by up to a tenth, new ones included",
                           reason="two to five per cent of exit speed between balls of one kind")
    follows = "ball"
    unseen = "counted as chance: each ball may have a speed of its own"
    sentence = "The balls differ: each has a speed of its own, faster or slower than the others."
    phrase = either_way("the balls differ: their speeds scatter by {}", SHARE)
    instrument = Instrument("ball_scale_each", "weight and size of each ball, and note which was shot (ball_id)", 0.01)
