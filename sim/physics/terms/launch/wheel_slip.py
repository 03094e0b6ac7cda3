"""Wheels that slip on the ball, the more the faster they turn: there is less time to bring it up to speed."""

from truearc.sim.physics.term import SHARE, Exit, Instrument, LaunchTerm, Rig, Values, amplitude, either_way


class WheelSlip(LaunchTerm):
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

    def leave(self, rig: Rig, values: Values, exit: Exit) -> Exit:
        return exit._replace(speed_m_s=exit.speed_m_s / (1.0 + values["loss_per_m_s"] * exit.speed_m_s))
