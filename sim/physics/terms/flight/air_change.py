"""Air that is not what it was when the believed coefficients were fitted: another season, another place."""

from truearc.sim.physics.term import SHARE, AirShareTerm, Instrument, amplitude, either_way


class AirChange(AirShareTerm):
    """All forces of the air x (1 + share). Fitted drag and lift absorb that whole, unless both were known before."""

    order = 180, "a share of all forces of the moving air"
    parameters = amplitude("share", "1", -0.5, 1.0, sd=0.08, meaning="air density above that of the earlier session",
                           source="forces of the air go with its density: 3.4 % for 10 K, 12 % for 1000 m of altitude",
                           reason="from a cold hall to a hot one, or from the coast to the hills")
    label = "denser or thinner air"
    relative = True
    sentence = "The air is denser or thinner than when the simulation was fitted."
    phrase = either_way("the air is {} <denser|thinner> than when the simulation was fitted", SHARE)
    instrument = Instrument("thermometer_barometer", "temperature and pressure, and those of the session before", None)
