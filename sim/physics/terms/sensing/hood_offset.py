"""A hood that stands at another angle than it reads, by the same angle everywhere."""

from truearc.sim.physics.term import ANGLE, HoodTerm, Instrument, amplitude, either_way


class HoodOffset(HoodTerm):
    """true elevation = measured + angle_deg."""

    order = 10, "sensors of the launch come first, in the order in which it is made"
    parameters = amplitude("angle_deg", "deg", -10.0, 10.0, sd=1.0, meaning="true elevation less the hood's reading",
                           source="a zero set by eye or by a hard stop is a degree off as often as not",
                           reason="a digital level sets a zero to a few tenths of a degree, the eye to one or two")
    sentence = "The hood stands at another angle than it reads, by the same angle at every setting."
    phrase = either_way("the hood stands {} <steeper|flatter> than it reads", ANGLE)
    instrument = Instrument("inclinometer", "hood angle with an inclinometer", 0.2)
