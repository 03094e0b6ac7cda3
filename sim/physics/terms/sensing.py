"""Terms of the sensing stage: errors of the robot's hood, wheels and camera, and of a ball tracker."""

import math
from typing import Any, ClassVar

import jax.numpy as jnp

from truearc.sim.physics import term
from truearc.sim.physics.term import ANGLE, LENGTH, SHARE, Instrument, Phrase, Vec, add, amplitude, either_way, scale


class HoodOffset(term.HoodTerm):
    """true elevation = measured + angle_deg."""

    order = 10, "sensors of the launch come first, in the order in which it is made"
    parameters = amplitude("angle_deg", "deg", -10.0, 10.0, sd=1.0, meaning="true elevation less the hood's reading",
                           source="a zero set by eye or by a hard stop is often off by a degree",
                           reason="a digital level sets a zero to a few tenths of a degree, the eye to one or two")
    sentence = "The hood stands at another angle than it reads, by the same angle at every setting."
    phrase = either_way("the hood stands {} <steeper|flatter> than it reads", ANGLE)
    instrument = Instrument("inclinometer", "hood angle with an inclinometer", 0.2)


class HoodBacklash(term.HoodTerm):
    """true elevation = measured + angle_deg x (+1 after moving up, -1 after moving down, 0 if unknown)."""

    order = 20, "adds up with the offset, in any order"
    parameters = amplitude("angle_deg", "deg", -5.0, 5.0, sd=0.7, meaning="true less read elevation, after moving up",
                           source="gears and chains of robot hoods have half a degree to a degree of play",
                           reason="a tooth of a 20-pitch gear rack has about as much; a spring against it leaves none")
    follows = "hood_change"
    sentence = ("The hood has play: after moving up it stands at another angle than after moving down to the same "
                "reading.")
    phrase = either_way("the hood has play: it stands {} <steeper|flatter> than it reads after moving up, as much "
                        "<flatter|steeper> after moving down", ANGLE)
    instrument = Instrument("inclinometer_both_ways", "hood angle with an inclinometer, from both sides", 0.2)


class EncoderScale(term.SensingTerm):
    """true surface speeds = measured x (1 + share), and with them exit speed and spin."""

    order = 30, "the wheels, which the hood has no part in"
    parameters = amplitude("share", "1", -0.2, 0.2, sd=0.01, meaning="surface speeds above the measured ones",
                           source="a wheel wears and grows with speed; encoders are exact except for a wrong ratio",
                           reason="a millimetre on a wheel of four inches is one per cent")
    direction = "along"
    sentence = ("The wheels run at other surface speeds than their encoders and stated diameters say, by the same "
                "share.")
    phrase = either_way("the wheels' surfaces run {} <faster|slower> than measured", SHARE)
    instrument = Instrument("calipers_tachometer",
                            "wheel diameter with calipers, wheel speed with an optical tachometer", 0.003)

    def sense(self, rig: term.Rig, values: term.Values, exit: term.Exit, distance_m: Any) -> tuple[term.Exit, Any]:
        factor = 1.0 + values["share"]
        return exit._replace(speed_m_s=exit.speed_m_s * factor, spin_rev_s=exit.spin_rev_s * factor), distance_m


class DistanceScale(term.DistanceTerm):
    """true distance = measured x (1 + share)."""

    order = 40, "a share of what the camera gives"
    parameters = amplitude("share", "1", -0.3, 0.3, sd=0.02, meaning="true distance above the measured one",
                           source="a focal length or target size off by a per cent puts every distance off by it",
                           reason="calibrations of the focal length repeat to about a per cent, as do printed targets")
    sentence = "The robot takes all distances as too long or too short by the same share."
    phrase = either_way("the target is {} <farther away|nearer> than measured", SHARE)
    instrument = Instrument("distance_tape", "distance with a tape at 3 stations", 0.005)

    def distance_m(self, measured_m: term.Number, amount: term.Number) -> term.Number:
        return measured_m * (1.0 + amount)


class DistanceBias(term.DistanceTerm):
    """true distance = measured + bias_m."""

    order = 50, "a true length, which the camera's scale has no part in"
    parameters = amplitude("bias_m", "m", -1.0, 1.0, sd=0.05, meaning="true distance less the measured one",
                           source="the camera, the exit and the plane of the target are not where the drawing has them",
                           reason="a mount, a lens and a target are each within a few centimetres of the drawing")
    sentence = "The robot takes all distances as too long or too short by the same length."
    phrase = either_way("the target is {} <farther away|nearer> than measured, wherever the robot stands", LENGTH)
    instrument = Instrument("distance_tape", "distance with a tape at 3 stations", 0.01)

    def distance_m(self, measured_m: term.Number, amount: term.Number) -> term.Number:
        return measured_m + amount


class VisionLatency(term.DistanceTerm):
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

    def distance_m(self, measured_m: term.Number, amount: term.Number) -> term.Number:
        return measured_m - amount


class TrackScale(term.WatchTerm):
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

    def watch(self, values: term.Values, position_m: Vec, velocity_m_s: Vec, time_s: term.Number) -> Vec:
        return add(position_m, scale(values["share"], position_m))


class _TurnedTracker(term.WatchTerm):
    """Positions appear rotated by angle_deg about a level axis on the floor below the exit."""

    way: ClassVar[str]                # the axis whose far end is seen higher
    instrument = Instrument("plumb_line", "a plumb line in the tracker's view", None)

    def watch(self, values: term.Values, position_m: Vec, velocity_m_s: Vec, time_s: term.Number) -> Vec:
        angle_rad = math.radians(1.0) * values["angle_deg"]
        cosine, sine = jnp.cos(angle_rad), jnp.sin(angle_rad)
        level, z = getattr(position_m, self.way), position_m.z
        return position_m._replace(**{self.way: level * cosine - z * sine, "z": z * cosine + level * sine})


def _turned_deg(sd: float, meaning: str) -> tuple[term.Parameter]:
    return amplitude("angle_deg", "deg", -15.0, 15.0, sd=sd, meaning=meaning,
                     source="a camera on a tripod is levelled by eye or by a bubble",
                     reason="a bubble is good to half a degree, the eye to one or two")


class TrackTilt(_TurnedTracker):
    """Positions appear rotated about the left axis on the floor below the exit; positive: higher ahead."""

    order = 80, "turns positions of any scale"
    way = "x"
    parameters = _turned_deg(1.0, "angle by which tracks point too high")
    direction = "vertical"
    calibration_sd = 2.5
    sentence = "The tracker is tilted: what lies ahead seems higher or lower than it is."
    phrase = either_way("the tracker is tilted: it sees what lies ahead {} too <high|low>", ANGLE)


class TrackRoll(_TurnedTracker):
    """Positions appear rotated about the forward axis on the floor below the exit; positive: higher to the left.

    It is much like a crosswind, whose push falls with the ball's speed.
    """

    order = 85, "turns positions of any scale"
    way = "y"
    parameters = _turned_deg(2.0, "angle by which tracks lean to the right")
    direction = "lateral"
    compared = True
    sentence = "The tracker is tilted sideways: what lies to the left seems higher or lower than it is."
    phrase = either_way("the tracker is tilted sideways: it sees what lies to the left {} too <high|low>", ANGLE)


class TrackClock(term.WatchTerm):
    """The tracker's time t is true time t (1 + share): position + velocity x share x t, to first order."""

    order = 90, "to first order independent of scale and tilt"
    parameters = amplitude("share", "1", -0.08, 0.08, sd=0.01, meaning="true time above the tracker's",
                           source="cheap cameras state 30 frames per second and give 29.97, or silently drop some",
                           reason="stated and true frame rates of cameras differ by up to a per cent or so")
    direction = "along"
    calibration_sd = 0.05
    sentence = "The tracker's clock runs fast or slow: its frames come at another rate than stated."
    phrase = either_way("the tracker's clock runs {} <slow|fast>", SHARE)
    instrument = Instrument("stopwatch", "a stopwatch in the tracker's view", None)

    def watch(self, values: term.Values, position_m: Vec, velocity_m_s: Vec, time_s: term.Number) -> Vec:
        return add(position_m, scale(values["share"] * time_s, velocity_m_s))


class TrackPerspective(term.WatchTerm):
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

    def watch(self, values: term.Values, position_m: Vec, velocity_m_s: Vec, time_s: term.Number) -> Vec:
        return add(position_m, scale(term.times(values["per_m"], position_m.z), position_m))
