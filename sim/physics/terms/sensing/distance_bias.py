"""A camera that takes all distances as too long or too short by the same length."""

from truearc.sim.physics.term import LENGTH, DistanceTerm, Instrument, Number, amplitude, either_way


class DistanceBias(DistanceTerm):
    """true distance = measured + bias_m."""

    order = 50, "a true length, which the camera's scale has no part in"
    parameters = amplitude("bias_m", "m", -1.0, 1.0, sd=0.05, meaning="true distance less the measured one",
                           source="the camera, the exit and the plane of the target are not where the drawing has them",
                           reason="a mount, a lens and a target are each within a few centimetres of the drawing")
    sentence = "The robot takes all distances as too long or too short by the same length."
    phrase = either_way("the target is {} <farther away|nearer> than measured, wherever the robot stands", LENGTH)
    instrument = Instrument("distance_tape", "distance with a tape at 3 stations", 0.01)

    def distance_m(self, measured_m: Number, amount: Number) -> Number:
        return measured_m + amount
