"""Terms of the sensing and launch stages: what sensors get wrong, and what happens while the wheels hold the ball."""

import math
from typing import Any, ClassVar

import jax.numpy as jnp

from truearc.sim.physics import term
from truearc.sim.physics.term import ANGLE, LENGTH, SHARE, Instrument, Phrase, Vec, add, amplitude, either_way, scale


class HoodOffset(term.HoodTerm):
    """true elevation = measured + angle_deg."""

    order = 10, "sensors of the launch come first, in the order in which it is made"
    parameters = amplitude("angle_deg", "deg", -10.0, 10.0, sd=1.0, meaning="true elevation less the hood's reading",
                           source="a zero set by eye or by a hard stop is a degree off as often as not",
                           reason="a digital level sets a zero to a few tenths of a degree, the eye to one or two")
    sentence = "The hood stands at another angle than it reads, by the same angle at every setting."
    phrase = either_way("the hood stands {} <steeper|flatter> than it reads", ANGLE)
    instrument = Instrument("inclinometer", "hood angle with an inclinometer", 0.2)


class HoodBacklash(term.HoodTerm):
    """true elevation = measured + angle_deg x (+1 after moving up, -1 after moving down, 0 where that is not known)."""

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
    """Positions are seen turned about a level axis on the floor below the exit by angle_deg."""

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
    """Positions are seen turned about the left axis on the floor below the exit; positive: higher, what lies ahead."""

    order = 80, "turns positions of any scale"
    way = "x"
    parameters = _turned_deg(1.0, "angle by which tracks point too high")
    direction = "vertical"
    calibration_sd = 2.5
    sentence = "The tracker is tilted: what lies ahead seems higher or lower than it is."
    phrase = either_way("the tracker is tilted: it sees what lies ahead {} too <high|low>", ANGLE)


class TrackRoll(_TurnedTracker):
    """Positions are seen turned about the forward axis on the floor below the exit; positive: higher, what lies left.

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


class WheelSlip(term.LaunchTerm):
    """exit speed = u / (1 + k u) with u the speed by the wheels: a share k u lost while that is small.

    The quotient rather than u (1 - k u): faster wheels never give a slower ball.
    """

    order = 10, "a matter of the wheels' speed; the losses are of what is left of it"
    parameters = amplitude(
        "loss_per_m_s", "s/m", 0.0, 0.05, sd=0.015, meaning="further share lost for each m/s of wheel speed",
        source="the share of surface speed that team 971's balls left with differed by 0.2 over its range of speeds",
        reason="0.015 s/m is 15 % lost at 10 m/s, about as much as was seen to depend on speed; around zero, for the "
        "constant part is another term's", by_ball=0.08)
    direction = "along"
    sentence = "The wheels slip on the ball, the more the faster they turn."
    phrase = either_way("the faster the wheels run, the <more the ball slips: it loses|better they grip: the ball "
                        "gains> {} of its speed for each m/s", SHARE, " per m/s of wheel surface")
    instrument = Instrument("exit_speed_film", "exit speed with a high-speed camera", 0.003, True)

    def leave(self, rig: term.Rig, values: term.Values, exit: term.Exit) -> term.Exit:
        return exit._replace(speed_m_s=exit.speed_m_s / (1.0 + values["loss_per_m_s"] * exit.speed_m_s))


class ExitEfficiency(term.SpeedTerm):
    """exit speed = speed by the wheels x (1 - loss), the same share at every speed; the spin is left as it is."""

    order = 20, "a share of the speed after slip"
    parameters = amplitude("loss", "1", 0.0, 0.9, scale="left", centre=0.2, sd=0.2,
                           meaning="share of the wheels' speed that the ball does not get",
                           source="team 971 measured 13 to 33 % below surface speed",
                           reason="67 to 87 % of surface speed were measured with wheels above and below; 0.2 on the "
                           "log of what is left is 54 to 98 % at two sigma", percent=True)
    sentence = "The ball leaves slower than the wheels' surfaces run, by the same share at every speed."
    phrase = either_way("the ball leaves {} <slower|faster> than the wheels' surfaces run", SHARE)
    instrument = Instrument("exit_speed_film", "exit speed with a high-speed camera", 0.02, True)


class WheelDroop(term.SpeedTerm):
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


class BallCompression(term.LaunchTerm):
    """spin / (1 - share); the speed of its centre stays."""

    order = 40, "a factor of the spin alone"
    parameters = amplitude("share", "1", -0.3, 0.6, sd=0.1, meaning="part of the radius by which the ball is squeezed",
                           source="teams found that a squeezed ball rolls like one up to a third smaller",
                           reason="foam balls are squeezed by a tenth to a half, and roll on less than what is left")
    direction = "vertical"
    sentence = "The squeezed ball rolls on a smaller radius than its own, so that it leaves with more spin."
    phrase = either_way("the <squeezed ball|ball> spins {} <faster|slower> than its size says", SHARE)
    instrument = Instrument("spin_film", "the spin of a marked ball as it leaves", 0.05)

    def leave(self, rig: term.Rig, values: term.Values, exit: term.Exit) -> term.Exit:
        return exit._replace(spin_rev_s=exit.spin_rev_s / (1.0 - values["share"]))


class BallWear(term.SpeedTerm):
    """exit speed x (1 - loss x age); age runs from 0 to 1 through the session, or through a ball's own shots."""

    order = 50, "a factor of the speed; these commute"
    parameters = amplitude("loss", "1", -0.5, 0.5, sd=0.03, meaning="share of the speed lost by the end of a session",
                           source="balls of a season are visibly smaller and torn at its end",
                           reason="none to five per cent of exit speed in a session")
    follows = "age"
    sentence = "The balls leave slower, or faster, the more they have been shot."
    phrase = either_way("the balls leave <slower|faster> the more they have been shot: {} by the end", SHARE)
    instrument = Instrument("speed_worn_balls", "the speed of new and worn balls in turn", 0.02)


class BallSpread(term.SpeedTerm):
    """exit speed x (1 + spread x the ball's own departure), a standard normal number that is not known."""

    sign = 1.0
    order = 60, "a factor of the speed; these commute"
    parameters = amplitude("spread", "1", 0.0, 0.3, sd=0.03, meaning="exit speed from ball to ball (sd)",
                           source="masses and stiffnesses of like balls differ by up to a tenth, new ones included",
                           reason="two to five per cent of exit speed between balls of one kind")
    follows = "ball"
    unseen = "counted as chance: each ball may have a speed of its own"
    sentence = "The balls differ: each has a speed of its own, faster or slower than the others."
    phrase = either_way("the balls differ: their speeds scatter by {}", SHARE)
    instrument = Instrument("ball_scale_each", "weight and size of each ball, and note which was shot (ball_id)", 0.01)


class BatterySag(term.SpeedTerm):
    """exit speed x (1 + sensitivity x (battery voltage / its median - 1))."""

    sign = 1.0
    order = 70, "a factor of the speed; these commute"
    parameters = amplitude("sensitivity", "1", -2.0, 2.0, sd=0.3, meaning="relative exit speed per relative voltage",
                           source="a motor holds its speed under the ball's load with the voltage that remains",
                           reason="a tenth of the voltage costs a few per cent of the speed; without control, a tenth")
    positive = 0.9                    # motors with less voltage push less
    follows = "battery"
    sentence = "A weaker battery gives a slower ball at the same wheel speed."
    phrase = either_way("a battery one tenth weaker sends the ball off {} "
                        "<slower|faster>", (10.0, " %"), " per tenth of voltage")
    instrument = Instrument("shots_full_empty_battery", "the same shot on a full and an empty battery", 0.1)


class RapidFire(term.SpeedTerm):
    """exit speed x (1 - loss x exp(-time since the session's last shot / time_constant_s))."""

    order = 80, "a factor of the speed; these commute"
    parameters = (
        *amplitude("loss", "1", -0.5, 0.5, sd=0.05, meaning="share of the speed lost right after another shot",
                   source="teams see the second of two quick shots fall short by a few per cent of speed",
                   reason="a wheel dips by up to a tenth, and its reading recovers before the ball's grip does"),
        term.Parameter("time_constant_s", "s", 0.05, 10.0, 0.7, "wheels under control come back within 0.3 to 2 s",
                       term.Prior("log", 0.7, 0.6, "0.2 to 2.3 s at two sigma, by motor, inertia and gains"),
                       meaning="time in which that fades to a third"))
    record = "t_s or since_last_shot_s of each shot"
    positive = 0.9                    # wheels that had no time to recover are slower
    sentence = "A shot soon after another leaves slower: the wheels have not recovered."
    phrase = either_way("a shot right after another leaves {} <slower|faster>", SHARE)
    instrument = Instrument("shots_short_long_pause", "the same shot after 1 s and after 10 s", 0.02)

    def at_shot(self, values: term.Values, circumstances: term.Circumstances) -> term.Values:
        left = jnp.exp(-circumstances.since_last_shot_s / values["time_constant_s"])
        return {**values, "loss": values["loss"] * left}


class ReleaseHeight(term.LaunchTerm):
    """The flight starts above_m over rig.toml's release height."""

    order = 90, "changes neither speed nor spin"
    parameters = amplitude("above_m", "m", -0.5, 0.5, sd=0.04, meaning="true release height less the stated one",
                           source="the ball lets go of the last wheel a few centimetres before or after the drawn "
                           "point",
                           reason="half a ball's radius, by how it is held and how the robot sits on its wheels")
    direction = "vertical"
    sentence = "The ball leaves higher or lower than the stated release height."
    phrase = either_way("the ball leaves from {} <higher|lower> than stated", LENGTH)
    instrument = Instrument("exit_height_tape", "exit height with a tape", 0.01)

    def leave(self, rig: term.Rig, values: term.Values, exit: term.Exit) -> term.Exit:
        return exit._replace(above_m=exit.above_m + values["above_m"])
