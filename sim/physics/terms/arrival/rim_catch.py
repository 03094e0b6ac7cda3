"""A rim that lets in balls that touch it, or throws out ones that should have gone in."""

from truearc.sim.physics.term import LENGTH, ArrivalTerm, Instrument, Opening, Phrase, Values, amplitude


class RimCatch(ArrivalTerm):
    """Both half heights of the opening grow by reach_m."""

    order = 20, "how large the opening is"
    parameters = amplitude("reach_m", "m", -0.05, 0.3, sd=0.03, meaning="true half height less the stated one",
                           source="a ball that touches the rim goes in or out by a few centimetres of its path",
                           reason="none to five centimetres of a rim's or a net's give")
    positive = 0.9                    # a rim lets balls in that touch it
    direction = "vertical"
    label = "forgiving rim"
    sentence = "The rim lets in balls that touch it, as if the opening were larger."
    phrase = Phrase("the opening takes balls that pass {} beyond its stated edges", "the opening is tighter than "
                    "stated, by {} at each edge", *LENGTH)
    instrument = Instrument("rim_film", "where balls touch the rim", 0.01)

    def arrive(self, values: Values, opening: Opening) -> Opening:
        reach_m = values["reach_m"]
        three_m = opening.three_half_m + reach_m * (opening.three_half_m > 0.0)       # 0: there is no three
        return opening._replace(three_half_m=three_m, two_half_m=opening.two_half_m + reach_m)
