"""Play in the hood: where it stands depends on the side from which it came."""

from truearc.sim.physics.term import ANGLE, HoodTerm, Instrument, amplitude, either_way


class HoodBacklash(HoodTerm):
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
