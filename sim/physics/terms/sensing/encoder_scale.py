"""Wheels that run faster or slower than they read, or are larger or smaller than stated."""

from truearc.sim.physics.term import SHARE, Exit, Instrument, Number, Rig, SensingTerm, Values, amplitude, either_way


class EncoderScale(SensingTerm):
    """true surface speeds = measured x (1 + share), and with them exit speed and spin."""

    order = 30, "the wheels, which the hood has no part in"
    parameters = amplitude("share", "1", -0.2, 0.2, sd=0.01, meaning="surface speeds above the measured ones",
                           source="a wheel wears and grows with speed; encoders are exact except for a wrong ratio",
                           reason="a millimetre on a wheel of four inches is one per cent")
    direction = "along"
    sentence = ("The wheels run at other surface speeds than their encoders and stated diameters say, by the same "
                "share.")
    phrase = either_way("the wheels' surfaces run {} <faster|slower> than measured", SHARE)
    instrument = Instrument("calipers_tachometer",
                            "wheel diameter with calipers, wheel speed with an optical tachometer", 0.003)

    def sense(self, rig: Rig, values: Values, exit: Exit, distance_m: Number) -> tuple[Exit, Number]:
        factor = 1.0 + values["share"]
        return exit._replace(speed_m_s=exit.speed_m_s * factor, spin_rev_s=exit.spin_rev_s * factor), distance_m
