"""A tracker whose metre is too long or too short."""

from truearc.sim.physics.term import SHARE, Instrument, Number, Values, Vec, WatchTerm, amplitude, either_way
from truearc.sim.physics.vector import add, scale


class TrackScale(WatchTerm):
    """seen position = position x (1 + share), from the floor below the exit."""

    order = 70, "trackers see what the sensors of the launch have no part in"
    parameters = amplitude("share", "1", -0.1, 0.1, sd=0.02, meaning="tracked lengths above the true ones",
                           source="pixels become metres by a scale measured in one plane; nearer balls look larger",
                           reason="a ball a hand away from the plane of calibration is off by a per cent or two")
    direction = "along"
    calibration_sd = 0.05
    sentence = "The tracker takes all lengths as too long or too short by the same share."
    phrase = either_way("the tracker sees lengths {} too <long|short>", SHARE)
    instrument = Instrument("ruler", "a ruler in the tracker's view", None)

    def watch(self, values: Values, position_m: Vec, velocity_m_s: Vec, time_s: Number) -> Vec:
        return add(position_m, scale(values["share"], position_m))
