"""A distance that is as old as the picture it came from, while the robot moves."""

from truearc.sim.physics.term import DistanceTerm, Instrument, Number, Phrase, amplitude


class VisionLatency(DistanceTerm):
    """true distance = measured - delay_s x closing speed; the effective value is that product, in m."""

    order = 60, "a true length, too: what the robot has driven"
    parameters = amplitude("delay_s", "s", 0.0, 0.5, sd=0.05, meaning="age of the distance at the shot",
                           source="vision pipelines of robots take 30 to 50 ms from light to distance",
                           reason="20 to 80 ms are usual, exposure and network included")
    follows = "closing_speed_m_s"
    sentence = ("The distance is out of date by the time of the shot: the robot has driven on since the picture was "
                "taken.")
    phrase = Phrase("the distance is {} out of date when the ball leaves", "the distance runs {} ahead of the robot",
                    1000.0, " ms")
    instrument = Instrument("delay_lamp", "the camera's delay, by a lamp in its view that the robot switches", 0.005)

    def distance_m(self, measured_m: Number, amount: Number) -> Number:
        return measured_m - amount
