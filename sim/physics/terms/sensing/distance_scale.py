"""A camera that takes all distances as too long or too short by the same share."""

from truearc.sim.physics.term import SHARE, DistanceTerm, Instrument, Number, amplitude, either_way


class DistanceScale(DistanceTerm):
    """true distance = measured x (1 + share)."""

    order = 40, "a share of what the camera gives"
    parameters = amplitude("share", "1", -0.3, 0.3, sd=0.02, meaning="true distance above the measured one",
                           source="a focal length or target size off by a per cent puts every distance off by it",
                           reason="calibrations of the focal length repeat to about a per cent, as do printed targets")
    sentence = "The robot takes all distances as too long or too short by the same share."
    phrase = either_way("the target is {} <farther away|nearer> than measured", SHARE)
    instrument = Instrument("distance_tape", "distance with a tape at 3 stations", 0.005)

    def distance_m(self, measured_m: Number, amount: Number) -> Number:
        return measured_m * (1.0 + amount)
