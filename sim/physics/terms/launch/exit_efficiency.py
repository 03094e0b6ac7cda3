"""A ball that leaves slower than the wheels' surfaces run: energy lost in squeezing it and in spinning it up."""

from truearc.sim.physics.term import SHARE, Instrument, SpeedTerm, amplitude, either_way


class ExitEfficiency(SpeedTerm):
    """exit speed = speed by the wheels x (1 - loss), the same share at every speed; the spin is left as it is."""

    order = 20, "a share of the speed after slip"
    parameters = amplitude("loss", "1", 0.0, 0.9, scale="left", centre=0.2, sd=0.2,
                           meaning="share of the wheels' speed that the ball does not get",
                           source="team 971 measured 13 to 33 % below surface speed",
                           reason="67 to 87 % of surface speed were measured with wheels above and below; 0.2 on the "
                           "log of what is left is 54 to 98 % at two sigma", percent=True)
    sentence = "The ball leaves slower than the wheels' surfaces run, by the same share at every speed."
    phrase = either_way("the ball leaves {} <slower|faster> than the wheels' surfaces run", SHARE)
    instrument = Instrument("exit_speed_film", "exit speed with a high-speed camera", 0.02, True)
