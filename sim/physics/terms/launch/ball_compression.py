"""A squeezed ball rolls on a smaller radius than its own, and so spins faster."""

from truearc.sim.physics.term import SHARE, Exit, Instrument, LaunchTerm, Rig, Values, amplitude, either_way


class BallCompression(LaunchTerm):
    """spin / (1 - share); the speed of its centre stays."""

    order = 40, "a factor of the spin alone"
    parameters = amplitude("share", "1", -0.3, 0.6, sd=0.1, meaning="part of the radius by which the ball is squeezed",
                           source="teams found that a squeezed ball rolls like one up to a third smaller",
                           reason="foam balls are squeezed by a tenth to a half, and roll on less than what is left")
    direction = "vertical"
    sentence = "The squeezed ball rolls on a smaller radius than its own, so that it leaves with more spin."
    phrase = either_way("the <squeezed ball|ball> spins {} <faster|slower> than its size says", SHARE)
    instrument = Instrument("spin_film", "the spin of a marked ball as it leaves", 0.05)

    def leave(self, rig: Rig, values: Values, exit: Exit) -> Exit:
        return exit._replace(spin_rev_s=exit.spin_rev_s / (1.0 - values["share"]))
