"""A tracker that is tilted to one side."""

import math

import jax.numpy as jnp

from truearc.sim.physics.term import ANGLE, Instrument, Number, Values, Vec, WatchTerm, amplitude, either_way


class TrackRoll(WatchTerm):
    """Positions are seen turned about the forward axis on the floor below the exit; positive: higher, what lies left.

    It is much like a crosswind, whose push falls with the ball's speed.
    """

    order = 85, "turns positions of any scale"
    parameters = amplitude("angle_deg", "deg", -15.0, 15.0, sd=2.0, meaning="angle by which tracks lean to the right",
                           source="a camera on a tripod is levelled by eye or by a bubble",
                           reason="a bubble is good to half a degree, the eye to one or two")
    direction = "lateral"
    compared = True
    sentence = "The tracker is tilted sideways: what lies to the left seems higher or lower than it is."
    phrase = either_way("the tracker is tilted sideways: it sees what lies to the left {} too <high|low>", ANGLE)
    instrument = Instrument("plumb_line", "a plumb line in the tracker's view", None)

    def watch(self, values: Values, position_m: Vec, velocity_m_s: Vec, time_s: Number) -> Vec:
        angle_rad = math.radians(1.0) * values["angle_deg"]
        cosine, sine = jnp.cos(angle_rad), jnp.sin(angle_rad)
        y, z = position_m.y, position_m.z
        return Vec(position_m.x, y * cosine - z * sine, z * cosine + y * sine)
