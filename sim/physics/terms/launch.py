"""Terms of the launch stage: the transfer of speed and spin from the wheels to the ball."""

import jax.numpy as jnp

from truearc.sim.physics import term
from truearc.sim.physics.term import LENGTH, SHARE, Instrument, Phrase, amplitude, either_way


class WheelSlip(term.LaunchTerm):
    """exit speed = u / (1 + k u), where u is the speed given by the wheels: the share lost is about k u.

    The quotient rather than u (1 - k u): faster wheels never give a slower ball.
    """

    order = 10, "a matter of the wheels' speed; the losses are of what is left of it"
    parameters = amplitude(
        "loss_per_m_s", "s/m", 0.0, 0.05, sd=0.015, meaning="further share lost for each m/s of wheel speed",
        source="the share of surface speed that team 971's balls left with differed by 0.2 over its range of speeds",
        reason="0.015 s/m is 15 % lost at 10 m/s, about as much as was seen to depend on speed; centred on zero, "
        "because another term has the constant part", by_ball=0.08)
    direction = "along"
    sentence = "The wheels slip on the ball, the more the faster they turn."
    phrase = either_way("the faster the wheels run, the <more the ball slips: it loses|better they grip: the ball "
                        "gains> {} of its speed for each m/s", SHARE, " per m/s of wheel surface")
    instrument = Instrument("exit_speed_film", "exit speed with a high-speed camera", 0.003, True)

    def leave(self, rig: term.Rig, values: term.Values, exit: term.Exit) -> term.Exit:
        return exit._replace(speed_m_s=exit.speed_m_s / (1.0 + values["loss_per_m_s"] * exit.speed_m_s))


class ExitEfficiency(term.SpeedTerm):
    """exit speed = speed given by the wheels x (1 - loss), the same share at every speed; the spin is unchanged."""

    order = 20, "a share of the speed after slip"
    parameters = amplitude("loss", "1", 0.0, 0.9, scale="left", centre=0.2, sd=0.2,
                           meaning="share of the wheels' speed that the ball does not get",
                           source="team 971 measured 13 to 33 % below surface speed",
                           reason="67 to 87 % of surface speed were measured with wheels above and below; 0.2 on the "
                           "log of what is left is 54 to 98 % at two sigma", percent=True,
                           below="so, other terms aside, balls leave faster than the wheels' surfaces run: make sure "
                           "of each wheel's radius_m and gear and of free_speed_rad_s in rig.toml, or of "
                           "exit_speed_m_s")
    sentence = "The ball leaves slower than the wheels' surfaces run, by the same share at every speed."
    phrase = either_way("the ball leaves {} <slower|faster> than the wheels' surfaces run", SHARE)
    instrument = Instrument("exit_speed_film", "exit speed with a high-speed camera", 0.02, True)


class WheelDroop(term.SpeedTerm):
    """exit speed x (1 - loss x droop); droop: the wheels' dip / the mean dip, 1 without telemetry."""

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
    """spin / (1 - share); the speed of the ball's centre is unchanged."""

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
    """exit speed x (1 + spread x the ball's own deviation), an unknown standard normal number."""

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
    """The flight starts above_m above the release height of rig.toml."""

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
