"""A tracker whose clock runs fast or slow: frames that come at another rate than stated."""

from truearc.sim.physics.term import SHARE, Instrument, Number, Values, Vec, WatchTerm, amplitude, either_way
from truearc.sim.physics.vector import add, scale


class TrackClock(WatchTerm):
    """At t of its clock the ball is where it is at t (1 + share): position + velocity x share x t, to first order."""

    order = 90, "to first order independent of scale and tilt"
    parameters = amplitude("share", "1", -0.08, 0.08, sd=0.01, meaning="true time above the tracker's",
                           source="cheap cameras state 30 frames per second and give 29.97, or silently drop some",
                           reason="stated and true frame rates of cameras differ by up to a per cent or so")
    direction = "along"
    calibration_sd = 0.05
    sentence = "The tracker's clock runs fast or slow: its frames come at another rate than stated."
    phrase = either_way("the tracker's clock runs {} <slow|fast>", SHARE)
    instrument = Instrument("stopwatch", "a stopwatch in the tracker's view", None)

    def watch(self, values: Values, position_m: Vec, velocity_m_s: Vec, time_s: Number) -> Vec:
        return add(position_m, scale(values["share"] * time_s, velocity_m_s))
