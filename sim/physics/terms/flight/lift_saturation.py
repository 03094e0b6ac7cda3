"""Lift that grows more slowly the faster the ball spins."""

import math

import jax.numpy as jnp

from truearc.sim.physics.term import BallState, ForceShareTerm, Instrument, Number, Rig, Values, amplitude, either_way
from truearc.sim.physics.vector import length

LEAST = 0.1                           # of 1 + rate S, should a search try rates far below 0


class LiftSaturation(ForceShareTerm):
    """Lift / (1 + rate S) with S = 2 pi r spin / speed."""

    of = "magnus"
    order = 150, "a share of the lift"
    parameters = amplitude("rate", "1", 0.0, 10.0, sd=1.0, meaning="how soon lift levels off as spin grows",
                           source="lift of baseballs depends on S alone and flattens with it (Nathan 2008)",
                           reason="tunnel data of sports balls flatten at S of about 0.3 to 1")
    direction = "vertical"
    sentence = "The lift no longer grows in proportion to the spin when the ball spins fast."
    phrase = either_way("lift <levels off as the ball spins faster|grows more than in proportion to spin>, at a rate "
                        "of {}")
    instrument = Instrument("spin_film", "the spin of a marked ball as it leaves", 0.3)

    def share(self, rig: Rig, values: Values, ball: BallState) -> Number:
        bend_m_s = values["rate"] * (2.0 * math.pi * rig.ball.radius_m) * length(ball.spin_rev_s)
        speed_m_s = length(ball.velocity_m_s)
        return -bend_m_s / jnp.maximum(speed_m_s + bend_m_s, LEAST * speed_m_s)
