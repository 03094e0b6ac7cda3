"""A ball that leaves the wheels higher or lower than stated."""

from truearc.sim.physics.term import LENGTH, Exit, Instrument, LaunchTerm, Rig, Values, amplitude, either_way


class ReleaseHeight(LaunchTerm):
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

    def leave(self, rig: Rig, values: Values, exit: Exit) -> Exit:
        return exit._replace(above_m=exit.above_m + values["above_m"])
