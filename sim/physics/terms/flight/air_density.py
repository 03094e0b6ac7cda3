"""Weather: thin air pushes less than dense air."""

from truearc.sim.physics.term import SHARE, AirShareTerm, Instrument, amplitude, either_way


class AirDensity(AirShareTerm):
    """All forces of the air x (1 + share x density's known departure from its median)."""

    order = 170, "a share of all forces of the moving air"
    parameters = amplitude("share", "1", 0.0, 2.0, sd=1.0, meaning="part of the gas law that the forces follow",
                           source="1 by definition: forces of the air are proportional to its density, 3.4 % for 10 K",
                           reason="0 is a simulation that knows no weather, 1 the ideal gas")
    follows = "density"
    law_sd = 0.2
    sentence = "The forces of the air change with its pressure and temperature."
    phrase = either_way("the forces of the air <follow|go against> its pressure and temperature, with {} of what the "
                        "gas law says", SHARE)
    instrument = Instrument("fall_film_cold_warm", "the fall of a ball on a cold and on a warm day", 0.3, True)
