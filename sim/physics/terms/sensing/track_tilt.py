"""A tracker whose horizon is not level."""

import math

import jax.numpy as jnp

from truearc.sim.physics.term import ANGLE, Instrument, Number, Values, Vec, WatchTerm, amplitude, either_way


class TrackTilt(WatchTerm):
    """Positions are seen turned about the left axis on the floor below the exit; positive: higher, what lies ahead."""

    order = 80, "turns positions of any scale"
    parameters = amplitude("angle_deg", "deg", -15.0, 15.0, sd=1.0, meaning="angle by which tracks point too high",
                           source="a camera on a tripod is levelled by eye or by a bubble",
                           reason="a bubble is good to half a degree, the eye to one or two")
    direction = "vertical"
    calibration_sd = 2.5
    sentence = "The tracker is tilted: what lies ahead seems higher or lower than it is."
    phrase = either_way("the tracker is tilted: it sees what lies ahead {} too <high|low>", ANGLE)
    instrument = Instrument("plumb_line", "a plumb line in the tracker's view", None)

    def watch(self, values: Values, position_m: Vec, velocity_m_s: Vec, time_s: Number) -> Vec:
        angle_rad = math.radians(1.0) * values["angle_deg"]
        cosine, sine = jnp.cos(angle_rad), jnp.sin(angle_rad)
        x, z = position_m.x, position_m.z
        return Vec(x * cosine - z * sine, position_m.y, z * cosine + x * sine)
