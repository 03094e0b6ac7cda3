"""Balls that leave faster or slower with the battery, at the same wheel speed."""

from truearc.sim.physics.term import Instrument, SpeedTerm, amplitude, either_way


class BatterySag(SpeedTerm):
    """exit speed x (1 + sensitivity x (battery voltage / its median - 1))."""

    sign = 1.0
    order = 70, "a factor of the speed; these commute"
    parameters = amplitude("sensitivity", "1", -2.0, 2.0, sd=0.3, meaning="relative exit speed per relative voltage",
                           source="a motor holds its speed under the ball's load with the voltage that remains",
                           reason="a tenth of the voltage costs a few per cent of the speed; without control, a tenth")
    positive = 0.9                    # motors with less voltage push less
    follows = "battery"
    sentence = "A weaker battery gives a slower ball at the same wheel speed."
    phrase = either_way("a battery one tenth weaker sends the ball off {} "
                        "<slower|faster>", (10.0, " %"), " per tenth of voltage")
    instrument = Instrument("shots_full_empty_battery", "the same shot on a full and an empty battery", 0.1)
