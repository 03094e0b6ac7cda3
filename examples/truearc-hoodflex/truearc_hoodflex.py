"""A hood that yields to the ball, and more so at higher wheel speeds.

This is an example of a term outside truearc (docs/how-to/add-a-term.md). Its first import has all names of truearc that
a term needs.
"""

import math

from truearc.sim.physics.term import ANGLE, Exit, Instrument, LaunchTerm, Rig, Values, amplitude, either_way

AT_M_S = 10.0                         # the exit speed at which the angle is stated


class HoodFlex(LaunchTerm):
    """true elevation = measured - angle_deg x (exit speed by the wheels / 10 m/s)^2: a spring under the ball's thrust.
    """

    order = 5, "bent by the wheels' own speed, before slip and losses take of it"
    parameters = amplitude("angle_deg", "deg", -5.0, 10.0, sd=1.0,
                           meaning="angle by which the hood yields at 10 m/s, positive: flatter",
                           source="made up for this example: a sheet of polycarbonate bends by degrees",
                           reason="a degree is felt by hand when the hood is pushed as hard as a ball does")
    direction = "vertical"
    sentence = "The hood yields to the ball, the more the faster the wheels turn."
    phrase = either_way("the hood yields to the ball: at 10 m/s it leaves {} <flatter|steeper> than the hood reads, "
                        "and with the square of the speed", ANGLE)
    instrument = Instrument("hood_film", "hood angle while a ball passes, on film at 240 frames/s", 0.3)

    def leave(self, rig: Rig, values: Values, exit: Exit) -> Exit:
        yielded_deg = values["angle_deg"] * (exit.speed_m_s / AT_M_S)**2
        return exit._replace(elevation_rad=exit.elevation_rad - math.radians(1.0) * yielded_deg)
