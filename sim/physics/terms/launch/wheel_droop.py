"""Wheels that slow down while the ball passes, so that it leaves slower than they ran before."""

from truearc.sim.physics.term import SHARE, Instrument, Phrase, SpeedTerm, amplitude


class WheelDroop(SpeedTerm):
    """exit speed x (1 - loss x droop); droop: dip of the wheels in this shot by the mean dip, 1 without telemetry."""

    order = 30, "a factor of the speed; these commute"
    parameters = amplitude("loss", "1", -0.5, 0.5, sd=0.05, meaning="share of the speed lost at the wheels' mean dip",
                           source="wheels dip by up to a tenth as a ball passes, light ones more, as teams report",
                           reason="a ball takes its energy out of the wheels'; a tenth lost at two sigma")
    positive = 0.9                    # a wheel that pushes a ball slows down
    follows = "droop"
    sentence = "The wheels slow down while the ball passes; the more they dip, the slower it leaves."
    phrase = Phrase("the wheels slow down under the ball: at their usual dip it leaves {} slower, at a larger one "
                    "slower still", "the more the wheels dip, the faster the ball leaves: {} at their usual dip",
                    *SHARE)
    instrument = Instrument("exit_speed_film_dip",
                            "exit speed at little and at much dip with a high-speed camera", 0.02, True)
