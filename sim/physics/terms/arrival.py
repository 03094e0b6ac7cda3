"""Terms of the arrival stage: effects of the height and size of the target's opening, and of its backboard."""

from truearc.sim.physics import term
from truearc.sim.physics.term import Instrument, Opening, Phrase, amplitude, either_way


class TargetHeight(term.ArrivalTerm):
    """The opening's centre is rise_m above its height in rig.toml; for one that faces up, its rim."""

    order = 10, "where the opening is, before how large"
    parameters = amplitude("rise_m", "m", -1.0, 1.0, sd=0.04, meaning="true height of the opening less the stated one",
                           source="fields are built to a few centimetres, floors are not level",
                           reason="a few centimetres by tape and floor")
    direction = "vertical"
    sentence = "The target stands higher or lower than stated."
    phrase = either_way("the target stands {} <higher|lower> than stated", term.LENGTH)
    instrument = Instrument("target_height_tape", "target height with a tape", 0.01)

    def arrive(self, values: term.Values, opening: Opening) -> Opening:
        return opening._replace(centre_m=opening.centre_m + values["rise_m"])


class RimCatch(term.ArrivalTerm):
    """Both half heights of the opening grow by reach_m; for one that faces up, all edges move outward by it."""

    order = 20, "how large the opening is"
    parameters = amplitude("reach_m", "m", -0.05, 0.3, sd=0.03, meaning="true half height less the stated one",
                           source="a ball that touches the rim goes in or out by a few centimetres of its path",
                           reason="none to five centimetres of a rim's or a net's give")
    positive = 0.9                    # a rim lets balls in that touch it
    direction = "vertical"
    label = "forgiving rim"
    sentence = "The rim lets in balls that touch it, as if the opening were larger."
    phrase = Phrase("the opening takes balls that pass {} beyond its stated edges", "the opening is tighter than "
                    "stated, by {} at each edge", *term.LENGTH)
    instrument = Instrument("rim_film", "where balls touch the rim", 0.01)

    def arrive(self, values: term.Values, opening: Opening) -> Opening:
        reach_m = values["reach_m"]
        three_m = opening.three_half_m + reach_m * (opening.three_half_m > 0.0)       # 0: there is no three
        return opening._replace(three_half_m=three_m, two_half_m=opening.two_half_m + reach_m)


class BackboardBounce(term.ArrivalTerm):
    """A ball keeps the share BOUNCE + more of its speed into the backboard."""

    order = 30, "what happens behind the opening, after where it is"
    parameters = amplitude("more", "1", -0.5, 0.4, sd=0.2, meaning="true share of speed kept less the usual one",
                           source="soft balls off thin boards keep a third, hard ones off stiff boards four fifths",
                           reason="balls and boards differ; a drop onto the board shows the share")
    direction = "along"
    of_backboard = True
    sentence = "Balls come off the backboard faster or slower than stated."
    phrase = either_way("balls keep {} <more|less> of their speed off the backboard", term.SHARE)
    instrument = Instrument("board_drop", "how high a ball bounces off the backboard, laid flat", 0.05)

    def arrive(self, values: term.Values, opening: Opening) -> Opening:
        return opening._replace(bounce=opening.bounce + values["more"])
