"""A ball that loses its spin in flight."""

import jax.numpy as jnp

from truearc.sim.physics.term import SECONDS, AirTerm, BallState, Instrument, Rig, Values, amplitude, either_way
from truearc.sim.physics.vector import scale


class SpinDecay(AirTerm):
    """spin = spin at release x exp(-rate_per_s x time since release)."""

    order = 10, "what spin is left, before the forces that it makes"
    parameters = amplitude("rate_per_s", "1/s", 0.0, 5.0, sd=0.4, meaning="rate of decay, 1 / time constant",
                           source="golf balls lose 3 to 4 % per second; a light ball of 18 cm at 10 m/s a quarter, by "
                           "the law seen for baseballs (Nathan 2008)",
                           reason="from golf's hundredths to the quarter by that law, and twice as much for foam")
    direction = "vertical"
    sentence = "The ball loses spin in flight."
    phrase = either_way("the ball <loses|gains> spin in flight, with a time constant of {}", SECONDS,
                        " (time constant)", rate=True)
    instrument = Instrument("spin_film_early_late", "the spin of a marked ball as it leaves and as it lands", 0.1)

    def meet(self, rig: Rig, values: Values, ball: BallState) -> BallState:
        return ball._replace(spin_rev_s=scale(jnp.exp(-values["rate_per_s"] * ball.time_s), ball.spin_rev_s))
