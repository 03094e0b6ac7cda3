"""A target that stands higher or lower than stated."""

from truearc.sim.physics.term import LENGTH, ArrivalTerm, Instrument, Opening, Values, amplitude, either_way


class TargetHeight(ArrivalTerm):
    """The opening's centre is rise_m over rig.toml's."""

    order = 10, "where the opening is, before how large"
    parameters = amplitude("rise_m", "m", -1.0, 1.0, sd=0.04, meaning="true height of the opening less the stated one",
                           source="fields are built to a few centimetres, floors are not level",
                           reason="a few centimetres by tape and floor")
    direction = "vertical"
    sentence = "The target stands higher or lower than stated."
    phrase = either_way("the target stands {} <higher|lower> than stated", LENGTH)
    instrument = Instrument("target_height_tape", "target height with a tape", 0.01)

    def arrive(self, values: Values, opening: Opening) -> Opening:
        return opening._replace(centre_m=opening.centre_m + values["rise_m"])
