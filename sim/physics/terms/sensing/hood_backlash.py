"""Play in the hood: where it stands depends on the side from which it came."""

from truearc.sim.physics.term import ANGLE, HoodTerm, Instrument, Phrase, amplitude


class HoodBacklash(HoodTerm):
    """true elevation = measured + angle_deg x (+1 after moving up, -1 after moving down, 0 where that is not known)."""

    order = 20, "adds up with the offset, in any order"
    parameters = amplitude(
        "angle_deg", "deg", -5.0, 5.0, sd=0.7, meaning="true elevation less the hood's reading, after moving up",
        source="gears and chains of robot hoods have half a degree to a degree of play",
        reason="a tooth of a 20-pitch gear rack has about as much play as this; a spring that takes it up leaves none")
    follows = "hood_change"
    record = "hood_deg of shots in their order"
    sentence = ("The hood has play: after moving up it stands at another angle than after moving down to the same "
                "reading.")
    phrase = Phrase("the hood has play: it stands {} steeper than it reads after moving up, as much flatter after "
                    "moving down", "the hood has play: it stands {} flatter than it reads after moving up, as much "
                    "steeper after moving down", *ANGLE)
    instrument = Instrument("inclinometer_both_ways", "hood angle with an inclinometer, from both sides", 0.2)
