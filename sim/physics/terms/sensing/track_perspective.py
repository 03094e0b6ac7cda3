"""A tracker whose metre changes with height: it looks up or down at the flight, as on a film from the ground."""

from truearc.sim.physics.term import SHARE, Instrument, Number, Values, Vec, WatchTerm, amplitude, either_way
from truearc.sim.physics.vector import add, scale, times


class TrackPerspective(WatchTerm):
    """seen position = position x (1 + per_m x height above the floor), to first order; negative: shrinks upward."""

    order = 100, "to first order independent of the other errors of the tracker"
    parameters = amplitude("per_m", "1/m", -0.1, 0.1, sd=0.01, meaning="growth of tracked lengths per metre of height",
                           source="seen from D m away at an angle a upward, lengths 1 m higher shrink by sin(a) / D",
                           reason="a tripod 5 m away whose camera is pitched by three degrees")
    direction = "vertical"
    sentence = "The tracker's metre changes with height: it looks up or down at the flight."
    phrase = either_way("the higher the ball, the <larger|smaller> the tracker sees lengths, by {} a "
                        "metre", SHARE, " per m of height")
    instrument = Instrument("ruler_two_heights", "a ruler at two heights in the tracker's view", None)

    def watch(self, values: Values, position_m: Vec, velocity_m_s: Vec, time_s: Number) -> Vec:
        return add(position_m, scale(times(values["per_m"], position_m.z), position_m))
